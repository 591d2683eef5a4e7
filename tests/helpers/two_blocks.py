"""The scenario of a laboratory test: a block on a fixed one, pressed down and pushed by an eccentric jack."""

from helpers.scenario_text import block, header, jack

BLOCKS = (
    header("convex", 0.62, 1e10, title="Two blocks and a jack", density=2600.0)
    + block("lower", (0.0, 0.0, -0.075), (0.4, 0.2, 0.15), "fixed = true")
    + block("upper", (0.0, 0.0, 0.075), (0.4, 0.2, 0.15))
    + '[[loads]]\nblock = "upper"\nforce = [0.0, 0.0, -1500.0]\n'
    + jack("upper", (0.12, 0.0, 0.075), (0.0, 1.0, 0.0))
    + '[control]\nkind = "yield"\ntolerance = 1.0e-3\n'
)
RATE = BLOCKS.replace('"yield"', '"displacement"').replace("tolerance = 1.0e-3", "rate = 1e-5\ntravel = 6e-5")
