#!/usr/bin/env bash
# Set up everything that the bench needs, once. Called by ./flexslew and by docker/.
# On a sourced ROS 2 (Jazzy, Kilted) that installation is used; elsewhere the ROS 2 wheels.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$root/.venv
started=$SECONDS

say() { printf '\033[1mflexslew\033[0m %s\n' "$*" >&2; }
fail() { printf 'flexslew: %s\n' "$*" >&2; exit 2; }

digest() { sha256sum "$@" | sha256sum | cut -c1-16; }

python=${FLEXSLEW_PYTHON:-python3}
command -v "$python" >/dev/null || fail "python3 is missing; install it with: apt-get install -y python3"
"$python" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' ||
  fail "Python 3.11 to 3.14 is needed, $python is $("$python" -V 2>&1); set FLEXSLEW_PYTHON to another one"

# 1. system packages: what a C++ build of the messages needs
missing=()
"$python" -c 'import ensurepip, venv' 2>/dev/null || missing+=(python3-venv)
"$python" -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))' ||
  missing+=(python3-dev)
command -v g++ >/dev/null || missing+=(g++)
command -v cmake >/dev/null || missing+=(cmake)
command -v ninja >/dev/null || missing+=(ninja-build)
if ((${#missing[@]})); then
  say "[1/4] system packages: ${missing[*]}"
  as_root=()
  if [ "$(id -u)" != 0 ]; then
    sudo -n true 2>/dev/null || fail "system packages are missing; install them with: sudo apt-get install -y ${missing[*]}"
    as_root=(sudo)
  fi
  command -v apt-get >/dev/null || fail "install by hand, there is no apt-get here: ${missing[*]}"
  "${as_root[@]}" apt-get update -qq
  DEBIAN_FRONTEND=noninteractive "${as_root[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
fi

# 2. Python packages
install_packages() {
  local told="$venv/pip.log"
  "$venv/bin/python" -m pip install --disable-pip-version-check --progress-bar off "$@" 2>"$told" |
    awk -v end="$(if [ -t 2 ]; then printf '\033[K'; else printf '\n'; fi)" '
      /^Collecting/ { if (++n % 10 == 1 || end != "\n") printf "\r  %d %s%s", n, $2, end }
      /^Installing/ { printf "\r  unpacking %d%s\n", n, end }
      { fflush() }' >&2 ||
    { grep -v WARNING "$told" | tail -5 >&2; fail "pip could not install $lock; the whole story is in $told"; }
}
installed_ros=${FLEXSLEW_INSTALLED_ROS:-}
lock=$root/setup/requirements.lock.txt
[ -n "$installed_ros" ] && lock=$root/setup/requirements.installed_ros.txt
stamp=$venv/flexslew.$(digest "$lock")
if [ ! -e "$stamp" ]; then
  say "[2/4] Python packages into .venv ($(grep -vc '^#' "$lock") distributions, about 1.6 GB)"
  rm -rf "$venv" "$root/ros2_ws/build" "$root/ros2_ws/install"
  if [ -n "$installed_ros" ]; then
    "$python" -m venv --system-site-packages "$venv"
    install_packages -r "$lock"
  else
    "$python" -m venv "$venv"
    install_packages --no-deps -r "$lock"
  fi
  touch "$venv/COLCON_IGNORE" "$stamp"
fi

# 3. the workspace
built=$root/ros2_ws/install/flexslew.$(cd "$root" && find ros2_ws/src setup/wheels_overlay -type f \
  \( -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name package.xml -o -name CMakeLists.txt \
  -o -name setup.py -o -name '*.launch.py' -o -path '*/config/*' \) | LC_ALL=C sort |
  xargs sha256sum "$stamp" | sed "s|$root/||" | sha256sum | cut -c1-16)
if [ ! -e "$built" ]; then
  say "[3/4] workspace (messages in C, about one minute)"
  . "$root/setup/environment.sh"
  paths=(src)
  options=(-DBUILD_TESTING=OFF "-DPython3_EXECUTABLE=$venv/bin/python" -GNinja)
  if [ -z "$installed_ros" ]; then
    paths+=("$root/setup/wheels_overlay")
    options+=("-DCMAKE_PROJECT_INCLUDE=$root/setup/wheels_fix.cmake")
  fi
  colcon=("$venv/bin/python" -m colcon)
  (cd "$root/ros2_ws" && "${colcon[@]}" --log-base log --log-level error build --base-paths "${paths[@]}" --symlink-install \
    --event-handlers console_direct- console_start_end+ --cmake-args "${options[@]}") >&2 ||
    fail "the workspace does not build; the compiler's words are in ros2_ws/log/latest_build"
  say "[4/4] machine code of the models, kept for later runs"
  . "$root/setup/environment.sh"
  "$venv/bin/python" -m flexslew_lab.trial.compile_kernels
  rm -f "$root"/ros2_ws/install/flexslew.*
  touch "$built"
  say "ready after $((SECONDS - started)) s"
fi
