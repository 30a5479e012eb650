#!/usr/bin/env bash
# Tests one package alone: in a fresh environment that holds only the package, the dependencies that it declares, and
# pytest. A dependency that is used but not declared fails here.
#
# usage: scripts/test_package.sh dgl-gam [pytest arguments]; the folder's name below packages/
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
export PATH="$PWD/.uv/bin:$PATH"

package=${1:?say which package, as in: scripts/test_package.sh dgl-gam}
shift
if [[ ! -f packages/$package/pyproject.toml ]]; then
  echo "no package '$package'; there are: $(ls packages | tr '\n' ' ')" >&2
  exit 2
fi

export UV_PROJECT_ENVIRONMENT="$PWD/.venvs/$package"
rm -rf "$UV_PROJECT_ENVIRONMENT"
name=$(sed -n 's/^name = "\(.*\)"/\1/p' "packages/$package/pyproject.toml")
# Of the workspace only this package with its extras; of its groups only its tests'.
# Built anew: a cached wheel of the same version may hold older sources.
uv sync --package "$name" --all-extras --no-default-groups --group test --no-editable --quiet \
  --reinstall-package "$name"
exec "$UV_PROJECT_ENVIRONMENT/bin/python" -m pytest "packages/$package/tests" -m "not slow" "$@"
