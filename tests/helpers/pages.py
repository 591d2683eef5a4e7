"""HTML pages of synthetic histories."""

import base64
import json
import re
from dataclasses import replace

import numpy as np

from dembrick import history
from helpers import history_cases as cases

EVIL = '</script><script>document.title="hacked"</script><img src=x onerror="document.title=1">&lt;$title ${data}'
POINT = {"V": 216.0, "V_lower": 215.0, "V_upper": 217.0, "bracket": "certified", "M_T": 16.2, "N": 467.0}
POINT |= {"V_1": 0.0, "V_2": 216.0, "torsion_centre": [-0.12, 0.0], "mechanism": "torsion-shear"}
RESULTS = {"title": "Set 4a", "formulation": "concave", "yield_point": POINT, "theory": {"V": 216.05, "error": -2e-4}}


def written(
    path, results=RESULTS, scenario=cases.SCENARIO, frames=4, rows=40, assembly=None, status="yield", control=None
):
    assembly = assembly or cases.assembly()
    n_joint, n_jack = len(assembly.joints), len(assembly.actuators.names)
    record = cases.moving_record if control is cases.MOTION else cases.record
    shifted = {"joint_shift": np.zeros((frames, n_joint, 2))} if control is cases.MOTION else {}
    with history.HistoryWriter(path, scenario, assembly, {}, control=control) as writer:
        if rows:
            writer.append(record(0, rows, n_joint, n_jack))
        if frames:
            writer.append_frames(*cases.frames(0, frames, len(assembly.names)), **shifted)
        writer.finish(status, results)
    return path


def evil_history(path):
    assembly = cases.assembly()
    assembly.names = (EVIL, "<!--")
    assembly.joints[0].law.formulation = "concave"
    assembly.actuators = replace(assembly.actuators, names=(EVIL,))
    point = POINT | {"mechanism": EVIL, "bracket": EVIL, "V_peak": EVIL, "joint": [EVIL, EVIL]}
    results = {"title": EVIL, "formulation": EVIL, "yield_point": point, "theory": [EVIL], "error": EVIL}
    return written(path, results | {"wall": EVIL, "steps": 1e999, "collapse": {"mechanism": EVIL}}, EVIL, status=EVIL,
                   assembly=assembly)  # fmt: skip


def data_of(text):
    (found,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    return json.loads(found)


def unpacked(text, kind="<f4"):
    return np.frombuffer(base64.b64decode(text), kind)
