# Sourced by the other scripts: installs what they need, and says so.
# apt is used as root or with sudo on Debian 12 and 13 and Ubuntu 24.04; elsewhere missing packages are listed.

say() { printf '\033[1m==\033[0m %s\n' "$*" >&2; }

die() {
  printf 'error: %s\n' "$*" >&2
  exit 1
}

as_root() {
  if [ "$(id -u)" = 0 ]; then
    "$@"
  elif command -v sudo >/dev/null; then
    sudo "$@"
  else
    die "root is needed for: $* (run it as root, then start again)"
  fi
}

# apt_packages NAME...: install those that are missing
apt_packages() {
  local missing=() package
  command -v dpkg-query >/dev/null || die "not Debian or Ubuntu; install the equivalents of: $*"
  for package in "$@"; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  say "installing with apt: ${missing[*]}"
  as_root apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

# python_environment EXTRA,... [FOLDER VERSIONS]: a virtual environment with the host and these extras,
# by default .venv, updated when its inputs change; its programs come first in PATH.
# VERSIONS: pinned (as in constraints.txt), newest, or lowest (that pyproject.toml allows).
python_environment() {
  local extras=$1 folder=${2:-.venv} versions=${3:-pinned} python pip stamp wanted
  python=$(command -v python3 || command -v python) || die "Python 3.11 or newer is needed"
  "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    die "Python 3.11 or newer is needed, this is $("$python" --version)"
  if [ ! -x "$folder/bin/pip" ] && [ ! -x "$folder/Scripts/pip.exe" ]; then
    "$python" -c 'import ensurepip' 2>/dev/null || apt_packages python3-venv
    "$python" -m venv "$folder"
  fi
  export PATH="$PWD/$folder/bin:$PWD/$folder/Scripts:$PATH" # Scripts on Windows
  stamp=$folder/installed-$extras
  wanted="$versions $(cat pyproject.toml constraints.txt | cksum) $PWD"
  [ "$versions" != newest ] && [ "$(cat "$stamp" 2>/dev/null)" = "$wanted" ] && return 0
  say "installing with pip into $folder: ccr-host and its extras $extras, $versions versions"
  pip=(python -m pip install --quiet --disable-pip-version-check)
  case $versions in
    pinned) "${pip[@]}" -c constraints.txt -e ".[$extras]" ;;
    newest) "${pip[@]}" --upgrade --upgrade-strategy eager -e ".[$extras]" ;;
    lowest)
      "${pip[@]}" -c constraints.txt uv
      uv pip install --quiet --python "$folder" --resolution lowest-direct -e ".[$extras]"
      ;;
  esac
  echo "$wanted" >"$stamp"
}
