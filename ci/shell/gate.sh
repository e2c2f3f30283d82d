#!/bin/sh
# Gate a change with r2bspec: gate.sh SPEC [BASE]
#
# SPEC is a spec, or a folder of specs, in a work tree of git. BASE is what it is compared with: a
# revision that the clone has; by default refs/remotes/origin/main. The exit status is that of
# 'r2bspec gate'.
#
#   R2BSPEC_PYTHON        a Python interpreter that has r2bspec; by default python3. For the HTML
#                         report it needs the extra 'report'
#   R2BSPEC_ALLOW         what may differ from the base, one name per line
#   R2BSPEC_INCONCLUSIVE  'fail', or 'pass' to let an inconclusive run pass
#   R2BSPEC_ARGUMENTS     further arguments of 'r2bspec gate', one per line
#   R2BSPEC_OUTPUT        a new folder for the run and its reports; by default a temporary one
set -u

spec=${1:?"usage: gate.sh SPEC [BASE]"}
base=${2:-refs/remotes/origin/main}
if [ -n "${R2BSPEC_OUTPUT:-}" ]; then
  folder=$R2BSPEC_OUTPUT
else
  folder=$(mktemp -d "${TMPDIR:-/tmp}/r2bspec.XXXXXXXXXX") || exit 2
fi
# Of two jobs with one folder, the second ends here.
mkdir -p -- "$folder" && mkdir -- "$folder/reports" || exit 2

python=${R2BSPEC_PYTHON:-python3}
set -- "--base=$base" --output "$folder/run" \
  --report "junit=$folder/reports/junit.xml" \
  --report "markdown=$folder/reports/summary.md" \
  --report "json=$folder/reports/result.json"
# -I: no module of the work tree is imported.
if "$python" -I -c 'import importlib.util as u, sys
sys.exit(u.find_spec("jinja2") is None)'; then
  set -- "$@" --report "html=$folder/reports/report.html"
else
  echo "There is no HTML report: it needs the extra 'report' of r2bspec."
fi
set -f
IFS='
'
for name in ${R2BSPEC_ALLOW:-}; do set -- "$@" "--allow=$name"; done
for argument in ${R2BSPEC_ARGUMENTS:-}; do set -- "$@" "$argument"; done
unset IFS
set +f

"$python" -I -m r2bspec gate "$@" -- "$spec" < /dev/null
status=$?
echo "The reports are in $folder/reports."
if [ "$status" = 0 ] && [ ! -s "$folder/reports/result.json" ]; then
  echo "There is no result."
  exit 4
fi
if [ "$status" = 3 ] && [ "${R2BSPEC_INCONCLUSIVE:-fail}" = pass ]; then
  echo "The run is inconclusive. It passes, because inconclusive is pass."
  exit 0
elif [ "$status" = 3 ]; then
  echo "The run is inconclusive. It blocks, unless inconclusive is pass."
fi
exit "$status"
