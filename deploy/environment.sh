# Sourced by the scripts beside it: makes the environment once, and again when its definition changes.
# JUNCNET_ENV names another place for it; JUNCNET_PYTHON another Python (3.11 or newer).
set -euo pipefail
checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
environment=${JUNCNET_ENV:-$checkout/.venv}

# environment EXTRAS: the environment has the project with these extras.
make_environment() {
    local extras=$1 python=${JUNCNET_PYTHON:-python3} wanted
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || {
        echo "JuncNet needs Python 3.11 or newer as python3 (or name one in JUNCNET_PYTHON)." >&2
        exit 2
    }
    wanted=$(cat "$checkout/pyproject.toml" "$checkout/deploy/constraints.txt" | cksum)
    if [ "$(cat "$environment/.juncnet-$extras" 2>/dev/null)" = "$wanted" ]; then return; fi
    echo "Making the environment in $environment (once) ..." >&2
    [ -x "$environment/bin/python" ] || "$python" -m venv "$environment"
    "$environment/bin/python" -m pip install --quiet --disable-pip-version-check \
        --constraint "$checkout/deploy/constraints.txt" --editable "$checkout[$extras]" >&2
    echo "$wanted" > "$environment/.juncnet-$extras"
}
