"""Validation: laboratory tests beside the answers of this program, each with its scatter and its error bar.

In go the tests of ``scenarios/validation/cases.toml``; out come rows of D (measured) with u_D, S (simulated) with
u_num, E = S - D, and whether its size is within what both leave open. A test that is
not met is a finding, not a failure.
"""
