"""Dense performances: heads whose every vertex moves in a known way, to judge what drives them by markers.

``muscles`` gives the built-in head muscles, ``face_units`` takes them from a head's own named units (MakeHuman,
ICT-FaceKit), ``performance`` lets them act. None of it is made by :mod:`evalkit.deform`, which it judges.
"""

from evalkit.dense.face import Face, Turn
from evalkit.dense.face_units import unit_face
from evalkit.dense.ict import skin_of_ict
from evalkit.dense.mouth import LipContact, lip_contact
from evalkit.dense.muscles import muscle_face
from evalkit.dense.performance import Performance, perform

__all__ = [
    "Face",
    "LipContact",
    "Performance",
    "Turn",
    "lip_contact",
    "muscle_face",
    "perform",
    "skin_of_ict",
    "unit_face",
]
