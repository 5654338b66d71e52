"""Dense performances: heads whose every vertex moves in a known way, to judge what drives them by markers.

``muscles`` gives the built-in head muscles, ``face_units`` takes them from a head's own named units (MakeHuman,
ICT-FaceKit), ``performance`` lets them act, ``characters`` pairs rough expressions with a sculptor's fine ones. None of
it is made by :mod:`evalkit.deform` or :mod:`evalkit.transfer`, which it judges.
"""

from evalkit.dense.characters import CHARACTERS, Character, animation, character, muzzle_character, shared_names
from evalkit.dense.face import Face, Turn
from evalkit.dense.face_units import unit_face
from evalkit.dense.ict import skin_of_ict
from evalkit.dense.mouth import LipContact, lip_contact
from evalkit.dense.muscles import muscle_face
from evalkit.dense.performance import Performance, perform

__all__ = [
    "CHARACTERS",
    "Character",
    "Face",
    "LipContact",
    "Performance",
    "Turn",
    "animation",
    "character",
    "lip_contact",
    "muscle_face",
    "muzzle_character",
    "perform",
    "shared_names",
    "skin_of_ict",
    "unit_face",
]
