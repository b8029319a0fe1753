# Sourced by scripts/demo and scripts/test: puts in place what they need, and says so.
# Works as root or with sudo on Debian 12 and Ubuntu 24.04; elsewhere it names what is missing.

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
  command -v dpkg-query >/dev/null || die "not a Debian or Ubuntu; install yourself what they call: $*"
  for package in "$@"; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  say "installing with apt: ${missing[*]}"
  as_root apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

# python_environment [EXTRA,...]: .venv with the host and these extras, renewed when pyproject.toml changes
python_environment() {
  local extras=${1:-} wanted
  python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    die "Python 3.11 or newer is needed, this is $(python3 --version)"
  if [ ! -x .venv/bin/pip ]; then
    python3 -c 'import ensurepip' 2>/dev/null || apt_packages python3-venv
    python3 -m venv .venv
  fi
  wanted="$extras $(cksum <pyproject.toml) $(pwd)"
  [ "$(cat ".venv/installed-${extras:-host}" 2>/dev/null)" = "$wanted" ] && return 0
  say "installing with pip into .venv: ccr-host${extras:+ and its extras $extras}"
  .venv/bin/pip install --quiet --disable-pip-version-check -e ".${extras:+[$extras]}"
  echo "$wanted" >".venv/installed-${extras:-host}"
}
