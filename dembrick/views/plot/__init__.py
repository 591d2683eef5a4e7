"""Figures of histories: force-displacement curves, yield domains with simulated points, loading layouts.

Every function returns a matplotlib ``Figure`` and draws into ``ax`` if given. matplotlib is imported only when a figure
is made; its state machine (pyplot) is not used, so no window or backend is touched.
"""

from dembrick.views.plot.causes import Motion, causes
from dembrick.views.plot.curves import (
    CurvePanel,
    MeasuredCurve,
    curve_panels,
    energies,
    force_displacement,
    read_measured,
    unbalanced,
)
from dembrick.views.plot.domains import RectangularJoint, domain_points, domains, interaction
from dembrick.views.plot.joint_plane import joint_plane, joint_stages
from dembrick.views.plot.layout import layout
from dembrick.views.plot.paths import joint_path, load_path
from dembrick.views.plot.points import control_points
from dembrick.views.plot.runs import labelled
from dembrick.views.plot.spectra import read_spectrum, spectra
from dembrick.views.plot.studies import StudyTable, is_study, read_study, study
from dembrick.views.plot.style import FORMATS, inline_svg, save
from dembrick.views.plot.subject import record_of

__all__ = [
    "FORMATS",
    "CurvePanel",
    "MeasuredCurve",
    "Motion",
    "RectangularJoint",
    "StudyTable",
    "causes",
    "control_points",
    "curve_panels",
    "domain_points",
    "domains",
    "energies",
    "force_displacement",
    "inline_svg",
    "interaction",
    "is_study",
    "joint_path",
    "joint_plane",
    "joint_stages",
    "labelled",
    "layout",
    "load_path",
    "read_measured",
    "read_spectrum",
    "read_study",
    "record_of",
    "save",
    "spectra",
    "study",
    "unbalanced",
]
