# SPDX-License-Identifier: GPL-3.0-or-later
"""Studies of touch: plan, trials, stimuli, session, answers and report."""
