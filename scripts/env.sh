# Source me in bash: `source scripts/env.sh` makes python, amb and the built packages of this workspace usable.
# Sourcing twice is harmless. What is on the paths of another ROS or workspace is left out: source an overlay after me.
# On a stock ROS 2 install source install/setup.bash instead.
if [ -z "${BASH_VERSION:-}" ]; then
    echo "env.sh: this shell is not bash; start one with: bash" >&2
    return 1
fi

_amb_root=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
_amb_problem=
if [ ! -f "$_amb_root/install/local_setup.bash" ]; then
    _amb_problem="the workspace is not set up; run: make setup"
elif [ "$(cat "$_amb_root/.venv/.root" 2> /dev/null)" != "$_amb_root" ]; then
    _amb_problem="the checkout was moved to $_amb_root; run: make setup"
fi
if [ -n "$_amb_problem" ]; then
    echo "env.sh: $_amb_problem" >&2
    unset _amb_root _amb_problem
    return 1
fi

_amb_first() {  # variable, folder: comes first, and once
    _amb_drop "$1" "$2"
    export "$1=$2${!1:+:${!1}}"
}

_amb_drop() {  # variable, folder
    local rest=":${!1:-}:"
    rest=${rest//":$2:"/:}
    rest=${rest#:}
    export "$1=${rest%:}"
}

unset PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH COLCON_CURRENT_PREFIX LD_LIBRARY_PATH
export VIRTUAL_ENV=$_amb_root/.venv
_amb_first PATH "$VIRTUAL_ENV/bin"
_amb_drop PATH "$_amb_root/install/amb_bringup/bin"  # local_setup.bash puts it first
export AMENT_PREFIX_PATH=$VIRTUAL_ENV CMAKE_PREFIX_PATH=$VIRTUAL_ENV

# The ROS wheels would set LD_LIBRARY_PATH by starting Python a second time; set here, every node starts faster.
for _amb_folder in "$VIRTUAL_ENV"/lib/python3.*/site-packages/ros_*.libs "$VIRTUAL_ENV/lib"; do
    if [ -d "$_amb_folder" ]; then _amb_first LD_LIBRARY_PATH "$_amb_folder"; fi
done
export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1

# Images of containers often set this; every node would then compile its 300 modules at each start, a quarter of a second.
unset PYTHONDONTWRITEBYTECODE

# One thread per process: the matrices of the workbench are small and several nodes share the cores.
export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1} OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}
export RMW_IMPLEMENTATION=rmw_fastrtps_cpp  # the wheels have no other

# Whoever reaches a node commands it, so the nodes keep to this host. To meet other hosts: SUBNET, before sourcing me.
[ -n "${ROS_LOCALHOST_ONLY:-}" ] || export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}

case $- in *u*) _amb_strict=-u ;; *) _amb_strict=+u ;; esac  # what colcon writes does not run under `set -u`
set +u
source "$_amb_root/install/local_setup.bash"
set "$_amb_strict"
unset _amb_root _amb_problem _amb_folder _amb_strict
unset -f _amb_first _amb_drop
