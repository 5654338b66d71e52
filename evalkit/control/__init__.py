"""Control signals to expression: factorisation of captures, motion database, filter, synthesis and retargeting.

The method is that of Chai, Xiao & Hodgins, "Vision-based control of 3D facial animation" (2003),
doi:10.2312/SCA03/193-206. The parts are imported by name; nothing is loaded before it is asked for.
"""
