# Source me in bash: `source scripts/env.sh` makes python, amb and the built packages of this workspace usable.
# Sourcing twice is harmless. On a stock ROS 2 install source install/setup.bash instead.
_amb_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
if [ ! -f "$_amb_root/install/local_setup.bash" ]; then
    echo "env.sh: the workspace is not set up; run: make setup" >&2
    unset _amb_root
    return 1
fi

_amb_prepend() {  # variable, folder
    case ":${!1:-}:" in
    *":$2:"*) ;;
    *) export "$1=$2${!1:+:${!1}}" ;;
    esac
}

export VIRTUAL_ENV=$_amb_root/.venv
_amb_prepend PATH "$VIRTUAL_ENV/bin"
_amb_prepend AMENT_PREFIX_PATH "$VIRTUAL_ENV"
_amb_prepend CMAKE_PREFIX_PATH "$VIRTUAL_ENV"

# The ROS wheels would set LD_LIBRARY_PATH by starting Python a second time; set here, every node starts faster.
for _amb_folder in "$VIRTUAL_ENV"/lib/python3.*/site-packages/ros_*.libs "$VIRTUAL_ENV/lib"; do
    if [ -d "$_amb_folder" ]; then _amb_prepend LD_LIBRARY_PATH "$_amb_folder"; fi
done
export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1

# One thread per process: the matrices of the workbench are small and several nodes share the cores.
export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1} OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}
export RMW_IMPLEMENTATION=${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp}

# Whoever reaches a node commands it, so the nodes keep to this host. To meet other hosts: SUBNET, before sourcing me.
[ -n "${ROS_LOCALHOST_ONLY:-}" ] || export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}

source "$_amb_root/install/local_setup.bash"
unset _amb_root _amb_folder
unset -f _amb_prepend
