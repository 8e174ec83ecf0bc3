"""Names of the workbench's topics, relative to the namespace of the nodes (/amb unless remapped)."""

POSITION = "position"
CURRENT_REFERENCE = "current_reference"
EXCITATION = "excitation"
EXCITATION_STATUS = "excitation_status"
TELEMETRY = "telemetry"
MODEL = "model"
REGION = "region"
REGION_MAP = "region_map"
PLANT_STATE = "plant_state"
SIMULATOR_STATE = "simulator/state"

NAMESPACE = "amb"
