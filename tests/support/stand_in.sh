#!/bin/bash
# Stands for Python with r2bspec: keeps the arguments and writes the reports that were asked for.
[ "$1 $2" = "-I -c" ] && exec "$PYTHON" "$@"
[ "$1 $2 $3" = "-I -m r2bspec" ] || exit 99
shift 3
[ "$1" = --version ] && exit "${BROKEN:-0}"
printf '%s\n' "$@" > arguments.txt
env > environment.txt
while [ $# -gt 0 ]; do
  case "$2" in
    json=*) [ -n "$NO_RESULT" ] || echo "{}" > "${2#json=}" ;;
    markdown=*)
      if [ -n "$SUMMARY" ]; then cat "$SUMMARY"; else echo "### summary"; fi > "${2#markdown=}" ;;
    junit=*) echo "<testsuites/>" > "${2#junit=}" ;;
    github=*) echo "::error file=a.r2b.yaml,line=9::too slow" > "${2#github=}" ;;
  esac
  shift
done
echo "::error::what a node printed"
exit "$STATUS"
