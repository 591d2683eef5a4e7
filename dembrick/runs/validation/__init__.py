"""Validation: laboratory tests compared with the answers of this program, with measured scatter and error bar.

Input are the tests of ``scenarios/validation/cases.toml``, output are rows of D (measured) with u_D, S (simulated) with
u_num, E = S - D, and whether its size is within both uncertainties. A test that is not met is a finding, not a
failure.
"""
