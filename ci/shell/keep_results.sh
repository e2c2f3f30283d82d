#!/bin/sh
# Keep the results of a run in a branch of the repository, and beside them the page of their trends.
#
#   sh keep_results.sh FOLDER    # of one run, or of the runs of several specs
#
# R2BSPEC_BRANCH   the branch (benchmarks), which has nothing else
# R2BSPEC_REMOTE   the remote, or an address that may push (origin)
# R2BSPEC_PYTHON   an interpreter that has r2bspec[report] (python3)
# R2BSPEC_PAGES    a folder that gets a copy of the page; empty for none
set -eu
branch=${R2BSPEC_BRANCH:-benchmarks} remote=${R2BSPEC_REMOTE:-origin}
commit=$(git rev-parse HEAD)
place=$(mktemp -d)
history=$place/history
as_r2bspec() { git -c user.name=r2bspec -c user.email=r2bspec@localhost "$@"; }

if git fetch --quiet --depth=1 "$remote" "refs/heads/$branch" 2>/dev/null; then
  start=FETCH_HEAD
else
  start=$(as_r2bspec commit-tree -m "Begin" "$(git hash-object -w -t tree /dev/null)")
fi
git worktree add --quiet --detach "$history" "$start"
trap 'git worktree remove --force "$history"; rm -rf -- "$place"' EXIT
mkdir -p "$history/results"
find "$1" -maxdepth 2 -name result.json | while IFS= read -r file; do
  cp -- "$file" "$history/results/$commit-$(basename "$(dirname "$file")").json"
done
"${R2BSPEC_PYTHON:-python3}" -I -m r2bspec trend "$history/results" \
  --report "html=$history/index.html" --report text=-
if [ -n "${R2BSPEC_PAGES:-}" ]; then
  mkdir -p "$R2BSPEC_PAGES" && cp -- "$history/index.html" "$R2BSPEC_PAGES/"
fi
git -C "$history" add --all
as_r2bspec -C "$history" commit --quiet --message "Results of $commit"
git -C "$history" push --quiet "$remote" "HEAD:refs/heads/$branch"
