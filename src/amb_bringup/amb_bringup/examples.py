"""A worked example of each command, which its help shows."""

from __future__ import annotations

from typing import Any

EXAMPLES = {
    "demo": "--params my_bearing.yaml --out results/mine",
    "status": "my_project",
    "new": "my_bearing.yaml --gap 0.4mm --turns 100 --mass 5kg --bias-current 2A --voltage 100V",
    "up": "--params my_bearing.yaml --composed",
    "view": "--map results/map",
    "experiment": "multisine --amplitude 2um --frequency-end 1.5kHz --params my_bearing.yaml",
    "excitation check": "sweep --amplitude 10um --frequency-end 400Hz --duration 10s",
    "excitation design": "multisine --frequency-end 1kHz --distortion-limit 0.05",
    "map": "--params my_bearing.yaml --amplitude-high 100um --out results/map",
    "regions": "results/demo/bag --out results/regions",
    "distortion": "results/demo/bag",
    "identify": "results/demo/bag --order auto --out results/model",
    "validate": "results/model/model.json other_bag",
    "compare": "order6.json order10.json other_bag",
    "model export": "results/model/model.json --c --mat",
    "certify": "results/model/model.json --controller paper --bag results/demo/bag",
    "tune chart": "my_bearing.yaml",
    "tune gains": "my_bearing.yaml",
    "commission": "--emulator --params my_rig.yaml",
    "rig up": "--params my_rig.yaml",
    "rig connect": "--patience 10s",
    "rig levitate": "",
    "rig land": "",
    "rig off": "",
    "rig disconnect": "",
    "rig reset": "",
    "rig status": "",
    "rig check": "192.168.1.20 --key-file my_rig.key",
    "rig demo": "--out results/rig-demo",
    "bag info": "results/demo/bag --runs",
    "bag play": "results/demo/bag --rate 0.5",
    "bag recover": "damaged_bag --out mended_bag",
    "bag export": "results/demo/bag --mat --from 0.5s --to 2s",
    "report": "results/demo/bag --certify --pdf",
    "plant describe": "--params my_bearing.yaml",
    "plant figures": "--params my_bearing.yaml --out results/plant",
    "plant modes": "--params my_rotor.yaml",
    "plant campbell": "--params my_rotor.yaml --max-speed 30000",
    "plant shaft": "--length 0.6m --diameter 40mm --bearings 0.2m --out shaft.npz",
    "plant ross": "rotor.toml --bearing-nodes 2,8 --out rotor.yaml",
    "reproduce": "--only fig2",
    "run": "amb_sim_node simulator --ros-args --params-file my_bearing.yaml",
    "foxglove": "--port 8765",
    "jitter": "--seconds 30 --out results/jitter.json",
    "campbell": "--params my_rotor.yaml --at 6000",
    "subharmonics": "--inducing-amplitude 5um",
}
"""By command: its arguments and options."""


def with_examples(command: Any, name: str) -> Any:
    """A click command of that name whose help ends with its example, and so that of its subcommands."""
    if name in EXAMPLES:
        command.epilog = f"Example: amb {name} {EXAMPLES[name]}".rstrip()
    for part, under in getattr(command, "commands", {}).items():
        with_examples(under, f"{name} {part}")
    return command
