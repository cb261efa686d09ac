# Sourced by install.sh: what some commands need besides .venv, and how it is installed.

# `./flexslew extras` installs all extras, or those that it names; `test` and `bench` need all.
extra_packages() {
  local list=$venv/requirements.extra.txt name size=0
  for name in "${extras[@]}"; do
    size=$((size + $(sed -n '1s/^#.*: \([0-9]*\) MB$/\1/p' "$(extra_lock "$name")")))
  done
  for name in "${extras[@]}"; do
    cat "$(extra_lock "$name")"
  done | awk '/^[A-Za-z0-9]/ { keep = !taken[$1]++ } keep' >"$list" # extras share some
  if [ -n "$installed_ros" ]; then beside_installed_ros <"$list" >"$list.rest" && mv "$list.rest" "$list"; fi
  install_wheels "$list" "extras ${extras[*]}: Python packages into .venv" "$size MB at most"
  for name in "${extras[@]}"; do touch "$(extra_stamp "$name")"; done
  case " ${extras[*]} " in *" export "*) ! workspace_built || machine_code --studies ;; esac
}

extra_lock() { echo "$root/setup/requirements.extra.$1.lock.txt"; }

extra_stamp() {
  local digest
  digest=$(sha256sum <"$(extra_lock "$1")")
  echo "$venv/flexslew.extras.$1.${digest:0:16}"
}

# extras_to_install NAME...: set `extras` to those that are not installed; nothing if one is unknown, which
# the command reports
extras_to_install() {
  local name names=("$@")
  if ! (($#)); then
    for name in "$root"/setup/requirements.extra.*.lock.txt; do
      name=${name##*.extra.}
      names+=("${name%.lock.txt}")
    done
  fi
  for name in "${names[@]}"; do
    case $name in -* | */*) extras=() && return ;; esac
    [ -e "$(extra_lock "$name")" ] || { extras=() && return; }
    [ -e "$packages" ] && [ -e "$(extra_stamp "$name")" ] || extras+=("$name")
  done
}

# Chromium with its driver, and `ip`, for the tests that need them: tried once, where this user may install packages.
test_programs() {
  local missing=()
  [ "${FLEXSLEW_BROWSER:-1}" = 0 ] || command -v chromedriver >/dev/null || missing+=(chromium chromium-driver)
  command -v ip >/dev/null || [ -x /usr/sbin/ip ] || missing+=(iproute2)
  touch "$test_programs"
  ((${#missing[@]})) || return 0
  say "system packages for the tests: ${missing[*]}"
  { command -v apt-get >/dev/null && may_install && apt_install "${missing[@]}"; } ||
    say "not installed; the tests that need them are skipped. Install them with: sudo apt-get install -y ${missing[*]}"
}
