"""The serial link to a VAL II or V+ controller.

It answers ``home`` (``Home`` -> ``Moved``) and ``move`` (``Move`` -> ``Moved``) as ``services.sim`` does: only the
next motion or the last one again is taken, a refusal says why (``Refusal``), and the answer states what was really
applied and from when on F/T samples show it. Nothing here has ever run on hardware.
"""
