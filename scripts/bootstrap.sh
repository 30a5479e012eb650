#!/usr/bin/env bash
# Installs what this project needs on a Linux machine with Python, git and make. Safe to run at any time: what is there
# already is left alone, and when nothing has changed since the last run it takes well under a second.
#
#   1. uv, into .uv/, when the machine has none that is new enough
#   2. the Python packages, into .venv/, at the versions pinned in pyproject.toml
#   3. a software Vulkan driver, when no usable device is found; "usable" is found out by drawing a picture
#
# Nothing is asked. Where something needs rights that are missing, the commands to run are printed, and the exit
# status is not zero.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly UV_FOLDER=.uv
readonly MIN_UV=0.8.0
readonly STAMP=.venv/.dgl-setup
readonly NEEDS_PACKAGES=75 # Exit status of `apt_install` when there are no rights to install.

say() { printf '%s\n' "$*" >&2; }
step() { say "==> $*"; }
die() {
  say "setup: $1"
  shift
  local line
  for line in "$@"; do say "    $line"; done
  exit 1
}

# ---------------------------------------------------------------------------------------------------------------------
# Rights and system packages
# ---------------------------------------------------------------------------------------------------------------------

# Runs a command as root: as it is when we are root, or through sudo when that needs no password.
as_root() {
  if [[ $(id -u) -eq 0 ]]; then
    "$@"
  else
    sudo -n "$@"
  fi
}

can_be_root() {
  [[ $(id -u) -eq 0 ]] || { command -v sudo >/dev/null && sudo -n true 2>/dev/null; }
}

has_apt() { command -v apt-get >/dev/null; }

has_package() { dpkg -s "$1" 2>/dev/null | grep -q '^Status: install ok installed'; }

# apt_install [-t SUITE] PACKAGE...
apt_install() {
  has_apt && can_be_root || return $NEEDS_PACKAGES
  step "apt-get install $*"
  as_root apt-get update -q >&2
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "$@" >&2
}

os_field() { # os_field NAME: a field of /etc/os-release, or nothing
  # shellcheck disable=SC1091
  [[ -r /etc/os-release ]] && (. /etc/os-release && printf '%s' "${!1:-}")
}

# ---------------------------------------------------------------------------------------------------------------------
# 1. uv
# ---------------------------------------------------------------------------------------------------------------------

has_new_uv() {
  local version
  version=$(uv --version 2>/dev/null | awk '{print $2}') || return 1
  [[ -n $version ]] && printf '%s\n%s\n' "$MIN_UV" "$version" | sort -V -C
}

# Three ways, since a distribution's Python may lack venv, or pip, or both, and may forbid installing beside its own
# packages; none of the three touches the system.
install_uv() {
  local python
  python=$(command -v python3 || command -v python) ||
    die "there is no Python; install one first" "Debian, Ubuntu: apt-get install python3 python3-venv"
  step "installing uv into $UV_FOLDER/"
  local log
  log=$(mktemp)
  if { rm -rf "$UV_FOLDER" && "$python" -m venv "$UV_FOLDER" &&
    "$UV_FOLDER/bin/python" -m pip install --quiet "uv>=$MIN_UV"; } >"$log" 2>&1; then
    :
  elif { rm -rf "$UV_FOLDER" &&
    "$python" -m pip install --quiet --target "$UV_FOLDER" "uv>=$MIN_UV"; } >>"$log" 2>&1; then
    :
  elif apt_install python3-venv && { rm -rf "$UV_FOLDER" && "$python" -m venv "$UV_FOLDER" &&
    "$UV_FOLDER/bin/python" -m pip install --quiet "uv>=$MIN_UV"; } >>"$log" 2>&1; then
    :
  else
    tail -n 5 "$log" >&2
    rm -rf "$log" "$UV_FOLDER"
    die "uv could not be installed (see above); do one of these, then run this again" \
      "Debian, Ubuntu: apt-get install python3-venv   (as root)" \
      "anywhere:       install uv yourself, at least $MIN_UV, so that 'uv --version' works"
  fi
  rm -f "$log"
}

ensure_uv() {
  export PATH="$PWD/$UV_FOLDER/bin:$PATH"
  has_new_uv || install_uv
  has_new_uv || die "uv was installed into $UV_FOLDER/ but does not run; remove that folder and run this again"
}

# ---------------------------------------------------------------------------------------------------------------------
# 3. Vulkan and the system libraries of the Python packages
# ---------------------------------------------------------------------------------------------------------------------

works() { .venv/bin/dgl doctor --only "$@" >/dev/null 2>&1; }

# OpenCV, which ManiSkill needs, is linked against these; a machine without a desktop lacks them.
ensure_system_libraries() {
  works packages && return
  step "the Python packages cannot be imported; trying the system libraries that they need"
  local package missing=()
  for package in libgl1 "$(glib_package)"; do
    has_package "$package" || missing+=("$package")
  done
  [[ ${#missing[@]} -eq 0 ]] || apt_install "${missing[@]}" || true
  works packages && return
  .venv/bin/dgl doctor --only packages >&2 || true
  die "the Python packages cannot be imported (see above)" \
    "Debian, Ubuntu: apt-get install libgl1 $(glib_package)   (as root)"
}

glib_package() { # Renamed by the 64-bit time transition, in Debian 13 and Ubuntu 24.04.
  if has_apt && apt-cache show libglib2.0-0t64 >/dev/null 2>&1; then
    printf libglib2.0-0t64
  else
    printf libglib2.0-0
  fi
}

ensure_vulkan() {
  works rendering && return
  step "no usable Vulkan device; installing Mesa's software driver"
  # A device that the user chose stays chosen: a driver installed beside it would not be used.
  local variable
  for variable in VK_DRIVER_FILES VK_ICD_FILENAMES; do
    [[ -z ${!variable:-} ]] || die "$variable is set to ${!variable}, but nothing can be drawn with it" "unset $variable"
  done
  if [[ $(os_field ID) == debian && $(os_field VERSION_ID) == 12 ]]; then
    install_mesa_backport || true
  else
    apt_install mesa-vulkan-drivers libvulkan1 || true
  fi
  works rendering && return
  .venv/bin/dgl doctor --only rendering >&2 || true
  explain_vulkan
}

# Debian 12's own Mesa, 22.3, lacks what SAPIEN asks for (partially bound descriptors); its backports have 25.0.
install_mesa_backport() {
  has_apt && can_be_root || return $NEEDS_PACKAGES
  local suite=bookworm-backports
  if ! apt-get indextargets --format '$(RELEASE)' 2>/dev/null | grep -qx "$suite"; then
    local mirror
    mirror=$(debian_mirror)
    [[ -n $mirror ]] || return 1
    step "adding the apt source $suite"
    backports_source "$mirror" | as_root tee /etc/apt/sources.list.d/dexgarmentlab-backports.sources >/dev/null
  fi
  apt_install -t "$suite" mesa-vulkan-drivers libvulkan1
}

# The mirror that this machine uses already, so that a private one keeps being used.
debian_mirror() {
  apt-get indextargets --format '$(RELEASE) $(COMPONENT) $(REPO_URI)' 2>/dev/null |
    awk '$1 == "bookworm" && $2 == "main" { print $3; exit }'
}

backports_source() { # backports_source MIRROR
  printf 'Types: deb\nURIs: %s\nSuites: bookworm-backports\nComponents: main\n' "$1"
  local key=/usr/share/keyrings/debian-archive-keyring.gpg
  [[ ! -e $key ]] || printf 'Signed-By: %s\n' "$key"
}

explain_vulkan() {
  if [[ $(os_field ID) == debian && $(os_field VERSION_ID) == 12 ]]; then
    local file=/etc/apt/sources.list.d/dexgarmentlab-backports.sources
    local mirror
    mirror=$(debian_mirror)
    die "nothing can be drawn: no usable Vulkan device; run these as root, then run this again" \
      "printf 'Types: deb\\nURIs: ${mirror:-<your Debian mirror>}\\nSuites: bookworm-backports\\nComponents: main\\n' > $file" \
      "apt-get update" \
      "apt-get install -t bookworm-backports mesa-vulkan-drivers libvulkan1"
  fi
  die "nothing can be drawn: no usable Vulkan device; do one of these, then run this again" \
    "with a graphics card:   install its driver with Vulkan" \
    "Debian 13, Ubuntu 24.04 or newer, as root: apt-get update && apt-get install mesa-vulkan-drivers libvulkan1" \
    "other distributions:    install Mesa's lavapipe, version 24 or newer (Fedora: mesa-vulkan-drivers; Arch: vulkan-swrast)"
}

# ---------------------------------------------------------------------------------------------------------------------
# What the last run saw: when none of this changed, there is nothing to do.
# ---------------------------------------------------------------------------------------------------------------------

fingerprint() {
  {
    cat pyproject.toml packages/*/pyproject.toml benchmarks/pyproject.toml .python-version scripts/bootstrap.sh
    printf '%s\n' "$PWD" "${VK_DRIVER_FILES:-}" "${VK_ICD_FILENAMES:-}"
    ls -l /usr/share/vulkan/icd.d /etc/vulkan/icd.d 2>/dev/null || true
  } | sha256sum | cut -d ' ' -f 1
}

is_up_to_date() {
  [[ -r $STAMP && $(<"$STAMP") == "$(fingerprint)" ]] || return 1
  # A look at the environment itself, without importing what takes seconds.
  .venv/bin/python -c '
import importlib.util as u, sys
names = "dexgarmentlab dgl_physics dgl_assets dgl_gam dgl_sadp dgl_tasks dgl_collect dgl_bench sapien warp torch mani_skill pytest"
sys.exit(any(u.find_spec(name) is None for name in names.split()))' 2>/dev/null
}

main() {
  [[ $(uname -s) == Linux ]] || die "this script knows Linux only; elsewhere install uv, then run 'uv sync'"
  ensure_uv
  if is_up_to_date; then
    return
  fi
  step "installing the Python packages into .venv/ (the first time, some gigabytes)"
  # uv compares what pyproject.toml pins with what is there, and changes only what differs.
  uv sync --all-packages
  ensure_system_libraries
  step "drawing a picture"
  ensure_vulkan
  fingerprint >"$STAMP"
  step "ready: 'make demo' runs the main job, 'dgl doctor' says what works here"
}

main "$@"
