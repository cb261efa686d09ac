# Source this: the bench's environment in this shell. This machine alone reaches the bench, unless FLEXSLEW_NETWORK=1.
flexslew_root=$(readlink -f -- "${BASH_SOURCE[0]}")
flexslew_root=${flexslew_root%/setup/*}
if [ -z "${FLEXSLEW_INSTALLED_ROS:-}" ]; then
  export AMENT_PREFIX_PATH=$flexslew_root/.venv${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}
  export CMAKE_PREFIX_PATH=$flexslew_root/.venv${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}
  export ROS_DISTRO=${FLEXSLEW_WHEELS:-kilted} ROS_VERSION=2 ROS_PYTHON_VERSION=3
fi
# Who can reach the bench, and the user's own ros2 commands in this shell; every node of the bench does the same by
# itself: flexslew_plant/network.py, which also says why
flexslew_profiles=$flexslew_root/ros2_ws/src/flexslew_plant/flexslew_plant/profiles
case ${ROS_DISTRO:-} in
  jazzy)
    flexslew_profile=FASTRTPS_DEFAULT_PROFILES_FILE flexslew_other=FASTDDS_DEFAULT_PROFILES_FILE flexslew_kind=jazzy.xml ;;
  *) flexslew_profile=FASTDDS_DEFAULT_PROFILES_FILE flexslew_other=FASTRTPS_DEFAULT_PROFILES_FILE flexslew_kind=xml ;;
esac
case ${FLEXSLEW_NETWORK:-0} in
  0)
    [ -f "$flexslew_profiles/loopback.$flexslew_kind" ] || {
      echo "flexslew: $flexslew_profiles/loopback.$flexslew_kind is missing; without it DDS would use every network" >&2
      return 2
    }
    unset FASTDDS_BUILTIN_TRANSPORTS FASTDDS_ENVIRONMENT_FILE ROS2_EASY_MODE ROS_DISCOVERY_SERVER ROS_LOCALHOST_ONLY \
      ROS_STATIC_PEERS ROS_SUPER_CLIENT "$flexslew_other"
    export ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT SKIP_DEFAULT_XML_FILE=1
    export "$flexslew_profile=$flexslew_profiles/loopback.$flexslew_kind"
    ;;
  1)
    if [ "${!flexslew_profile:-}" -ef "$flexslew_profiles/loopback.$flexslew_kind" ]; then # an installed one may be a link
      unset "$flexslew_profile" ROS_AUTOMATIC_DISCOVERY_RANGE SKIP_DEFAULT_XML_FILE
    fi
    export "$flexslew_profile=${!flexslew_profile:-$flexslew_profiles/network.$flexslew_kind}"
    if [ "${!flexslew_profile}" -ef "$flexslew_profiles/network.$flexslew_kind" ]; then
      export FASTDDS_BUILTIN_TRANSPORTS=${FASTDDS_BUILTIN_TRANSPORTS:-UDPv4}
    fi
    ;;
  *)
    echo "flexslew: FLEXSLEW_NETWORK: '$FLEXSLEW_NETWORK' is not allowed: 0 (this machine alone) or 1" >&2
    return 2
    ;;
esac
export COLCON_PYTHON_EXECUTABLE=$flexslew_root/.venv/bin/python
export PATH=$flexslew_root/.venv/bin:$PATH
if [ -e "$flexslew_root/ros2_ws/install/environment.sh" ]; then . "$flexslew_root/ros2_ws/install/environment.sh"; fi
unset PYTHONDONTWRITEBYTECODE # a node starts in half the time where Python keeps what it compiled
# one thread, as every node has: else the last bits of a large design depend on the number of cores
export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1} OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}
# Numba looks at a kernel's own file only; a kernel that inlines another one must follow it, too
export NUMBA_CACHE_DIR=$(grep -lrE "@(compiled|called|inlined|merged|overload|vectorised)|from numba" --include='*.py' \
  "$flexslew_root/ros2_ws/src" | LC_ALL=C sort | xargs cat | sha256sum)
NUMBA_CACHE_DIR=$flexslew_root/.numba_cache/${NUMBA_CACHE_DIR:0:12}
