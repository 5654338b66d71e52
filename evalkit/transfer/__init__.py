"""Character Transfer: rough blendshapes become a character's own, from a few sculpted examples.

Kato et al., "Character Transfer: example-based individuality retargeting for facial animations", WSCG 2014.
"""
