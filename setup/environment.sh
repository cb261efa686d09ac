# Source this: the bench's environment in this shell. Loopback only unless you say otherwise.
flexslew_root=$(readlink -f -- "${BASH_SOURCE[0]}")
flexslew_root=${flexslew_root%/setup/*}
if [ -z "${FLEXSLEW_INSTALLED_ROS:-}" ]; then
  export AMENT_PREFIX_PATH=$flexslew_root/.venv${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}
  export CMAKE_PREFIX_PATH=$flexslew_root/.venv${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}
  export ROS_DISTRO=kilted ROS_VERSION=2 ROS_PYTHON_VERSION=3
fi
export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}
case ${ROS_DISTRO:-} in
  jazzy) export FASTRTPS_DEFAULT_PROFILES_FILE=${FASTRTPS_DEFAULT_PROFILES_FILE:-$flexslew_root/setup/fastdds.xml} ;;
  *) export FASTDDS_DEFAULT_PROFILES_FILE=${FASTDDS_DEFAULT_PROFILES_FILE:-$flexslew_root/setup/fastdds.xml} ;;
esac
export COLCON_PYTHON_EXECUTABLE=$flexslew_root/.venv/bin/python
export PATH=$flexslew_root/.venv/bin:$PATH
if [ -e "$flexslew_root/ros2_ws/install/environment.sh" ]; then . "$flexslew_root/ros2_ws/install/environment.sh"; fi
unset PYTHONDONTWRITEBYTECODE # a node starts in half the time where Python keeps what it compiled
# one thread, as every node has: else the last bits of a large design depend on the number of cores
export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1} OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}
# Numba looks at a kernel's own file only; a kernel that inlines another one must follow it, too
export NUMBA_CACHE_DIR=$(grep -lrE "@(compiled|called|inlined|overload|vectorised)|from numba" --include='*.py' \
  "$flexslew_root/ros2_ws/src" | LC_ALL=C sort | xargs cat | sha256sum)
NUMBA_CACHE_DIR=$flexslew_root/.numba_cache/${NUMBA_CACHE_DIR:0:12}
