"""Makes the data files of this folder: one small closed loop, in shapes in which rigs and programs save their records.

Run `python tests/data/own_data/make.py`. The loop is that of a rigid mass on an ideal magnetic bearing, sampled with a
zero-order hold, so its poles are known: plus and minus sqrt(k_s / m).
"""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

HERE = Path(__file__).parent
MASS, CURRENT_STIFFNESS, NEGATIVE_STIFFNESS = 6.25, 66.0, 3.3e5  # kg, N/A, N/m
GAINS = (20_000.0, 38.0)  # A/m, A s/m
POLE = float(np.sqrt(NEGATIVE_STIFFNESS / MASS))
"""The unstable pole (1/s); the stable one is its negative."""
TYPES = get_typestore(Stores.ROS2_JAZZY)
NOISE = 2e-9  # m, rms


def loop(
    axes: int = 1,
    steps: int = 700,
    rate: float = 5_000.0,
    seed: int = 1,
    times: np.ndarray | None = None,
    smooth: bool = False,
):
    """Times (s), currents (A), positions (m) and references (m) of a PD-controlled loop, shapes (steps, axes)."""
    random = np.random.default_rng(seed)
    time = np.arange(steps) / rate if times is None else times
    hold = np.append(np.diff(time), 1.0 / rate)
    reference = np.repeat(10e-6 * random.choice([-1.0, 1.0], size=(steps // 7 + 1, axes)), 7, axis=0)[:steps]
    if smooth:  # as a simulation of variable step has it
        phases = random.uniform(0.0, 2.0 * np.pi, 30)
        angles = 2.0 * np.pi * np.outer(time, 25.0 * np.arange(1, 31)) + phases
        reference = 3e-6 * np.cos(angles).sum(axis=1, keepdims=True)
    noise = (0.0 if smooth else NOISE) * random.normal(size=(steps, axes))
    state, last = np.zeros((2, axes)), reference[0] if smooth else np.zeros(axes)
    currents, positions = np.empty((steps, axes)), np.empty((steps, axes))
    for step in range(steps):
        positions[step] = state[0] + noise[step]
        error = reference[step] - positions[step]
        span = hold[step - 1] if step else hold[0]
        currents[step] = GAINS[0] * error + GAINS[1] * (error - last) / span
        last = error
        force = CURRENT_STIFFNESS * currents[step] / NEGATIVE_STIFFNESS
        grow, shear = np.cosh(POLE * hold[step]), np.sinh(POLE * hold[step])
        moved = state[0] + force
        state = np.array([grow * moved + shear / POLE * state[1] - force, POLE * shear * moved + grow * state[1]])
    return time, currents, positions, reference


def text(name: str, heads: list[str], columns: list[np.ndarray], mark: str = ",", comma: bool = False, **more) -> None:
    """Write a text table; `more` may have encoding, formats, newline, before."""
    formats = more.get("formats", ["%.7g"] * len(columns))
    rows = [mark.join(f % v for f, v in zip(formats, row, strict=True)) for row in zip(*columns, strict=True)]
    rows = [row.replace(".", ",") for row in rows] if comma else rows
    lines = [*more.get("before", []), *heads, *rows]
    content = more.get("newline", "\n").join(lines) + more.get("newline", "\n")
    (HERE / name).write_bytes(content.encode(more.get("encoding", "utf-8")))


def texts() -> None:
    """Text files."""
    t, i, x, r = loop(2, 500)
    both = [t, 1e3 * i[:, 0], 1e3 * i[:, 1], 1e6 * x[:, 0], 1e6 * x[:, 1]]
    heads = ["Zeit (s)", "Strom X [mA]", "Strom Y [mA]", "Lage X [µm]", "Lage Y [µm]"]
    text("excel_de.csv", [";".join(heads)], both, ";", True, encoding="utf-8-sig", newline="\r\n")
    t, i, x, r = (item if item.ndim == 1 else item[:, 0] for item in loop(rate=8_000.0))
    text("units_row.tsv", ["time\tcoil\tgap", "s\tA\tum"], [t, i, 1e6 * x], "\t")
    text("no_header.csv", [], [t, i, 1e6 * x])
    before = ["Model,DS1054Z", "Points,700", "# recorded on the rig", "% second comment", ""]
    text("oscilloscope.csv", ["Time (ms),i_x (A),x (mm),r_x (mm)"], [1e3 * t, i, 1e3 * x, 1e3 * r], before=before)
    text("spaces.dat", ["  current   position"], [i, 1e3 * x], "   ", formats=["%12.8f", "%12.9f"])
    text("french.csv", ["Temps (ms);Courant (A);Déplacement (µm)"], [1e3 * t, i, 1e6 * x], ";", True, encoding="cp1252")
    text("japanese.txt", ["時間 [s]\t電流 [A]\t変位 [um]"], [t, i, 1e6 * x], "\t", encoding="utf-16")
    text("mil.csv", ["t [s],i_x [mA],x [mil]"], [t, 1e3 * i, x / 25.4e-6], formats=["%.6f", "%.5f", "%.8f"])
    text("with_reference.csv", ["time [s],i_x [A],x [m],r_x [m]"], [t, i, x, r], formats=["%.6f", "%.8g", "%.8g", "%g"])
    t2, i2, x2, _ = (item if item.ndim == 1 else item[:, 0] for item in loop(rate=12_345.6, steps=800))
    text("odd_rate.csv", ["t [us],drive [A],probe [um]"], [1e6 * t2, i2, 1e6 * x2], formats=["%.4f", "%.8g", "%.8g"])
    kept = np.r_[0:400, 430:700]
    text("missing_rows.csv", ["time [s],i_x [A],x [um]"], [t[kept], i[kept], 1e6 * x[kept]])
    holes = x.copy()
    holes[[120, 121, 407]] = np.nan
    text("holes.csv", ["time [s],i_x [A],x [um]"], [t, i, 1e6 * holes])
    slow = np.where(np.arange(len(x)) % 4 == 0, x, np.nan)
    text("slow_gauge.csv", ["time [s],i_x [A],x [um]"], [t, i, 1e6 * slow])
    text("suffixes.csv", ["time_ms,i_x_mA,x_um"], [1e3 * t, 1e3 * i, 1e6 * x])
    stamps = t + np.random.default_rng(5).uniform(-0.35, 0.35, len(t)) / 8_000.0
    text("jitter.csv", ["time [s],i_x [A],x [um]"], [stamps, i, 1e6 * x], formats=["%.8f", "%.7g", "%.7g"])
    uneven = np.cumsum(np.random.default_rng(6).uniform(0.85, 1.15, 900)) / 40_000.0
    tv, iv, xv, _ = (item if item.ndim == 1 else item[:, 0] for item in loop(1, 900, 40_000.0, 1, uneven, True))
    text("variable_step.csv", ["time [s],i_x [A],x [um]"], [tv, iv, 1e6 * xv], formats=["%.9f", "%.9g", "%.9g"])
    text("comma_comma.csv", ["i_x [A],x [um]"], [i[:200], 1e6 * x[:200]], ",", True, formats=["%.6f", "%.6f"])
    text("counter.csv", ["time,i_x [A],x [um]"], [np.arange(700), i, 1e6 * x], formats=["%d", "%.7g", "%.7g"])
    text("no_units.csv", ["time [s],i_x,x"], [t, i, 1e6 * x])
    (HERE / "letter.txt").write_text("Dear colleague,\nthe records are on the other disk.\n")
    (HERE / "truncated.csv").write_bytes((HERE / "mil.csv").read_bytes()[:-9])


def binaries() -> None:
    """MAT, NPZ and Parquet files."""
    t, i, x, r = loop(2, 600, 6_400.0)
    savemat(HERE / "matrix_v5.mat", {"log": np.column_stack([i, x]).astype(np.float64), "Ts": 1.0 / 6_400.0})
    fields = {"time": t[:, None], "i_x": i[:, :1], "i_y": i[:, 1:], "x": x[:, :1], "y": x[:, 1:]}
    savemat(HERE / "struct_v5.mat", {"rig": fields | {"r_x": r[:, :1], "r_y": r[:, 1:]}}, do_compression=True)
    with h5py.File(HERE / "v73.mat", "w", userblock_size=512) as file:
        for name, value in {"t": t[:, None], "u": i, "y": 1e6 * x}.items():
            item = file.create_dataset(name, data=np.ascontiguousarray(value.T), compression="gzip")
            item.attrs["MATLAB_class"] = np.bytes_("double")
    with (HERE / "v73.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, made by tests".ljust(124) + b"\x00\x02IM")
    np.savez_compressed(HERE / "arrays.npz", u=1e3 * i, y=1e6 * x, fs=np.array(6_400.0))
    np.save(HERE / "rows.npy", np.vstack([i.T, x.T])[:, :400])
    stamps = pa.array(np.round(1e9 * t).astype(np.int64) + 1_700_000_000_000_000_000, pa.timestamp("ns"))
    parts = [stamps, *(pa.array(part) for part in (i[:, 0], i[:, 1], 1e6 * x[:, 0], 1e6 * x[:, 1]))]
    names = ["timestamp", "amp1 (A)", "amp2 (A)", "probe1 (um)", "probe2 (um)"]
    parquet.write_table(pa.table(parts, names=names), HERE / "log.parquet", compression="zstd")


def bag(name: str, topics: dict[str, str], rows: list[list[tuple[str, object]]], times: np.ndarray) -> None:
    """Write a bag: for each time (ns), messages by topic."""
    shutil.rmtree(HERE / name, ignore_errors=True)
    with Writer(HERE / name, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        there = {topic: writer.add_connection(topic, kind, typestore=TYPES) for topic, kind in topics.items()}
        for row, time in zip(rows, times, strict=True):
            for topic, message in row:
                writer.write(there[topic], int(time), TYPES.serialize_cdr(message, topics[topic]))


def bags() -> None:
    """Bags of others, with standard messages."""
    t, i, x, _ = loop(2, 330, 5_000.0)
    times = np.round(1e9 * t).astype(np.int64) + 1_700_000_000_000_000_000
    kind = {name: TYPES.types[name] for name in TYPES.types}
    stamp, header = kind["builtin_interfaces/msg/Time"], kind["std_msgs/msg/Header"]
    layout = kind["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    array, joints, scalar = "std_msgs/msg/Float64MultiArray", "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"
    rows = [
        [("/rig/signals", kind[array](layout=layout, data=np.array([*a, *(1e6 * b)])))]
        for a, b in zip(i, x, strict=True)
    ]
    bag("multi_array", {"/rig/signals": array}, rows, times)
    late = times + np.random.default_rng(3).integers(0, 900_000, len(times))  # recorded late, stamped right
    rows = [
        [
            (
                "/joint_states",
                kind[joints](
                    header=header(stamp=stamp(sec=int(ns // 10**9), nanosec=int(ns % 10**9)), frame_id=""),
                    name=["x", "y"], position=b, velocity=np.empty(0), effort=a,
                ),
            )
        ]
        for ns, a, b in zip(times, i, x, strict=True)
    ]  # fmt: skip
    bag("joint_states", {"/joint_states": joints}, rows, np.sort(late))
    topics = {"/coil/current": scalar, "/rotor/position": scalar, "/temperature": scalar}
    rows = [
        [("/coil/current", kind[scalar](data=a)), ("/rotor/position", kind[scalar](data=1e6 * b))]
        for a, b in zip(i[:, 0], x[:, 0], strict=True)
    ]
    bag("scalars", topics, rows, times)


if __name__ == "__main__":
    texts()
    binaries()
    bags()
