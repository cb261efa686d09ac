#!/usr/bin/env bash
# Set up everything that the bench needs, once. Sourced by ./flexslew, called by docker/.
# On a sourced ROS 2 (Jazzy, Kilted) that installation is used; elsewhere the ROS 2 wheels, of Kilted unless
# FLEXSLEW_WHEELS says jazzy.
set -euo pipefail
root=$(readlink -f -- "${BASH_SOURCE[0]}")
root=${root%/setup/*}
venv=$root/.venv
python=${FLEXSLEW_PYTHON:-python3}
installed_ros=${FLEXSLEW_INSTALLED_ROS:-}
wheels=${FLEXSLEW_WHEELS:-kilted}
lock=$root/setup/requirements.lock.txt
jazzy=$root/setup/requirements.jazzy.lock.txt
sources=$root/setup/requirements.source.txt
all=$([ "${BASH_SOURCE[0]}" != "$0" ] || echo --wait) # an image is whole when this script ends
started=$SECONDS
step=
. "$root/setup/extras.sh"

say() { printf '\033[1mflexslew\033[0m %s\n' "$*" >&2; }
fail() { printf 'flexslew: %s\n' "$*" >&2; exit 2; }

# Run a long step in a process group of its own: an interrupt ends all of it and leaves the rest to us.
run() {
  set -m
  "$@" &
  step=$!
  set +m
  local status=0
  wait "$step" || status=$?
  step=
  return "$status"
}

interrupted() {
  trap 'kill -KILL -- "-$step" 2>/dev/null || true' INT TERM
  if [ -n "$step" ]; then
    kill -INT -- "-$step" 2>/dev/null || true
    while kill -0 -- "-$step" 2>/dev/null; do sleep 0.05; done
  fi
  printf '\nflexslew: interrupted; the next call goes on from here\n' >&2
  exit "$1"
}

# 1. Python, and the system packages that a C++ build of the messages needs
system_packages() {
  command -v "$python" >/dev/null || fail "python3 is missing; install it with: apt-get install -y python3"
  "$python" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' ||
    fail "Python 3.11 to 3.14 is needed, $python is $("$python" -V 2>&1); set FLEXSLEW_PYTHON to another one"
  local missing=()
  "$python" -c 'import ensurepip, venv' 2>/dev/null || missing+=(python3-venv)
  "$python" -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))' ||
    missing+=(python3-dev)
  command -v g++ >/dev/null || missing+=(g++)
  command -v cmake >/dev/null || missing+=(cmake)
  command -v ninja >/dev/null || missing+=(ninja-build)
  ((${#missing[@]})) || return 0
  say "[1/4] system packages: ${missing[*]}"
  command -v apt-get >/dev/null || fail "install by hand, there is no apt-get here: ${missing[*]}"
  may_install || fail "system packages are missing; install them with: sudo apt-get install -y ${missing[*]}"
  apt_install "${missing[@]}" || fail "apt-get could not install: ${missing[*]}"
}

may_install() { [ "$(id -u)" = 0 ] || sudo -n true 2>/dev/null; }

apt_install() {
  local as_root=()
  [ "$(id -u)" = 0 ] || as_root=(sudo -n)
  run "${as_root[@]}" apt-get update -qq || { say "apt-get update failed"; return 1; }
  run "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# 2. Python packages. An interrupted installation of the same list goes on, another one begins anew.
python_packages() {
  local list isolation=()
  [ -z "$installed_ros" ] || isolation=(--system-site-packages)
  if [ ! -e "$packages.begun" ]; then
    rm -rf "$venv" "$root/ros2_ws/build" "$root/ros2_ws/install"
    run "$python" -m venv "${isolation[@]}" "$venv" || fail "$python could not make $venv"
    touch "$venv/COLCON_IGNORE" "$packages.begun"
  fi
  list=$venv/requirements.txt
  if [ -n "$installed_ros" ]; then
    beside_installed_ros <"$lock" >"$list"
  elif [ "$wheels" = jazzy ]; then
    { without_wheels_of_ros <"$lock" && cat "$jazzy"; } >"$list"
  else
    cp "$lock" "$list"
  fi
  install_wheels "$list" "[2/4] Python packages into .venv" "$size"
  if [ -z "$installed_ros" ]; then
    run pip_install 1 --require-hashes --no-deps --no-build-isolation --use-pep517 -r "$sources" || pip_failed "$sources"
  fi
  links_for_copies
  rm -f "$packages.begun"
  touch "$packages"
}

# A wheel holds no links: a library with three names stands in it three times.
links_for_copies() {
  local library short
  for library in "$venv"/lib/lib*.so.*.*.*; do
    for short in "${library%.*}" "${library%%.so.*}.so"; do
      ! cmp -s "$library" "$short" || ln -sf "${library##*/}" "$short"
    done
  done
}

# install_wheels LIST WORDS SIZE
install_wheels() {
  local count
  count=$(grep -c '^[A-Za-z0-9]' "$1")
  say "$2 ($count distributions, $3)"
  # a package cut off while it was unpacked has no list of its files
  for unpacked in "$venv"/lib/python3*/site-packages/*.dist-info; do
    [ ! -d "$unpacked" ] || [ -e "$unpacked/RECORD" ] || rm -rf "$unpacked"
  done
  run pip_install "$count" --require-hashes --only-binary ':all:' --no-deps -r "$1" || pip_failed "$1"
}

# The lock without what an installed ROS 2 brings: its packages, their parsers, and the NumPy that they are built for (1.26
# on Ubuntu 24.04), with which ctrlsys, FMPy, onnx and pandas do not work.
beside_installed_ros() {
  awk '/^[A-Za-z0-9]/ { keep = !/^(ros-|catkin-pkg==|ctrlsys==|fmpy==|lark-parser==|ml-dtypes==|numpy==|onnx==|pandas==|pyyeti==)/ } keep'
}

# The lock without ROS 2 itself.
without_wheels_of_ros() {
  awk '/^[A-Za-z0-9]/ { keep = !/^ros-/ } keep'
}

pip_failed() {
  grep -v WARNING "$venv/pip.log" | tail -5 >&2
  fail "pip could not install $1; all it said is in $venv/pip.log"
}

# A terminal gets one line that changes, a file one line per 25 distributions.
pip_install() {
  "$venv/bin/python" -P -m pip install --disable-pip-version-check --progress-bar off --no-compile "${@:2}" \
    2>"$venv/pip.log" | awk -v count="$1" -v terminal="$([ ! -t 2 ] || echo yes)" '
      /^Collecting/ { n++; if (terminal) printf "\r  %d of %d: %s\033[K", n, count, $2 }
      /^Collecting/ && !terminal && n % 25 == 0 { printf "  %d of %d\n", n, count }
      /^Installing/ { printf "%s  unpacking %d\n", terminal ? "\r\033[K" : "", n }
      { fflush() }' >&2
}

# 3. the workspace, and 4. machine code
build_workspace() {
  local paths=(src) options=(-DBUILD_TESTING=OFF "-DPython3_EXECUTABLE=$venv/bin/python" -GNinja)
  if [ -z "$installed_ros" ]; then
    paths+=("$root/setup/wheels_overlay")
    options+=("-DCMAKE_PROJECT_INCLUDE=$root/setup/wheels_fix.cmake" -DFLEXSLEW_MSGS_CPP=OFF)
  fi
  say "[3/4] workspace (messages in C, about half a minute)"
  . "$root/setup/environment.sh"
  run colcon_build --base-paths "${paths[@]}" --symlink-install \
    --event-handlers console_direct- console_start_end+ --cmake-args "${options[@]}" ||
    fail "the workspace does not build; what the compiler said is in ros2_ws/log/latest_build"
  workspace_environment
  say "[4/4] machine code of the $([ -n "$all" ] && echo models || echo 'default trial; the rest follows in the background')"
  machine_code $all
  rm -f "$root"/ros2_ws/install/flexslew.*
  echo "$root" >"$workspace"
}

machine_code() {
  . "$root/setup/environment.sh"
  run "$venv/bin/python" -P -m flexslew_lab.compile_kernels "$@" || fail "the models do not compile"
}

# What local_setup.bash sets, as plain lines: asking it takes longer than all the rest of ./flexslew --help
workspace_environment() {
  env -i PATH="$PATH" COLCON_PYTHON_EXECUTABLE="$venv/bin/python" bash -c '
    set -e
    . "$1/local_setup.bash"
    for name in AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH; do
      value=${!name:-}
      [ -z "$value" ] || echo "export $name=${value%:}\${$name:+:\$$name}"
    done' bash "$root/ros2_ws/install" >"$workspace_lines.$$" || fail "$root/ros2_ws/install is not whole; remove it"
  mv "$workspace_lines.$$" "$workspace_lines"
}

# A checkout that was moved or copied: its absolute paths are rewritten, which takes seconds.
mend_paths() {
  local before
  before=$(built_for)
  [ -n "$before" ] && [ "$before" != "$root" ] || return 0
  say "the checkout was in $before; its paths are rewritten"
  "$python" "$root/setup/moved.py" "$before" "$root" || fail "the paths cannot be rewritten; remove $venv and $root/ros2_ws/install"
}

built_for() { cat "$root"/ros2_ws/install/flexslew.* 2>/dev/null || true; }

colcon_build() {
  cd "$root/ros2_ws" && "$venv/bin/python" -P -m colcon --log-base log --log-level error build "$@" >&2
}

case $root in
  *[[:space:]\"\'\\\$\`:\;\&\(\)\<\>\|\*\?\[\]\{\}\#%!]*)
    fail "the checkout is in '$root'; the build tools of ROS 2 allow no spaces, quotes or shell signs in a path; move it" ;;
esac
case $root in
  *[![:ascii:]]*)
    fail "the checkout is in '$root'; the build tools of ROS 2 allow only ASCII letters in a path; move it" ;;
esac
size="about 700 MB"
# each process started here delays every command
case $wheels in
  kilted) locks=("$lock" "$sources") ;;
  jazzy) locks=("$lock" "$sources" "$jazzy") ;;
  *) fail "FLEXSLEW_WHEELS: '$wheels' is not allowed: kilted or jazzy" ;;
esac
packages_digest=$(cat "${locks[@]}" <(printf %s "$installed_ros") | sha256sum)
packages=$venv/flexslew.${packages_digest:0:16}
test_programs=$venv/flexslew.test_programs
workspace_lines=$root/ros2_ws/install/environment.sh
workspace_digest=$({
  echo "${packages_digest:0:16}"
  cd "$root"
  find ros2_ws/src setup/wheels_overlay setup/wheels_fix.cmake -type f \
    \( -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name package.xml -o -name CMakeLists.txt \
    -o -name setup.py -o -name '*.launch.py' -o -name '*.cmake' -o -path '*/config/*' \) -print0 |
    LC_ALL=C sort -z | xargs -0 sha256sum
} | sha256sum)
workspace=$root/ros2_ws/install/flexslew.${workspace_digest:0:16}
extras=()
case ${all:-${1:-}} in # .venv is enough for the others
  --wait | bench | test) extras_to_install ;;
  extras) extras_to_install "${@:2}" ;;
esac
case ${1:-} in test) ;; *) test_programs=$packages ;; esac
workspace_built() { [ -e "$workspace" ] && [ "$(<"$workspace")" = "$root" ]; }
if [ ! -e "$packages" ] || [ ! -e "$test_programs" ] || ((${#extras[@]})) || ! workspace_built; then
  trap 'interrupted 130' INT
  trap 'interrupted 143' TERM
  machine=$(uname -m)
  case $machine in
    x86_64 | amd64) ;;
    aarch64 | arm64)
      [ -n "$installed_ros" ] ||
        fail "ROS 2 has no wheels for $machine: source an installed ROS 2 (Jazzy or Kilted); without ROS: pip install ." ;;
    *) fail "no packages are pinned for $machine: a 64-bit Intel, AMD or ARM processor is needed; without ROS: pip install ." ;;
  esac
  system_packages
  mend_paths
  if [ ! -e "$packages" ]; then python_packages; fi
  if ((${#extras[@]})); then extra_packages; fi
  if [ ! -e "$test_programs" ]; then test_programs; fi
  workspace_built || build_workspace
  trap - INT TERM
  say "ready after $((SECONDS - started)) s"
fi
[ -e "$workspace_lines" ] || workspace_environment
