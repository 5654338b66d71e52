"""Methods of other packages, called as a careful user of theirs would, to stand beside evalkit's own in studies.

Each is an entry of the usual table, named ``peer-...``, with ``peer=True`` and the package's name and version as
``origin``; it is there only where the package is installed, and the package is imported when the entry is first called.
None is needed by anything else in evalkit.

========================== =================================== ======================================================
entry                      package (version tried)             called
========================== =================================== ======================================================
peer-scipy                 scipy 1.17.1                        ``Rotation.align_vectors``, frame by frame
peer-kineticstoolkit       kineticstoolkit 0.17.0              ``geometry.register_points``
peer-scikit-surgery-aos    scikit-surgerycalibration 1.2.6     ``pivot_calibration``, method ``aos``
peer-scikit-surgery-sphere scikit-surgerycalibration 1.2.6     ``pivot_calibration``, method ``sphere_fitting``
peer-biobuddy-score        biobuddy 0.3.2                      ``Score.perform_algorithm``
========================== =================================== ======================================================

``pip install evalkit[peers]`` brings scikit-surgerycalibration and biobuddy, some 75 MB, most of it the OpenCV and
Sphinx that the former requires and its pivot calibration does not use; beside numpy 2.4 pip has to go back to OpenCV
4.11, which ``constraints.txt`` tells it at once. kineticstoolkit requires PyQt5 (200 MB installed) for windows that
nothing here opens; install it by hand to have its entry.

What these packages do with data that cannot answer is theirs, and is not repaired here: what they raise becomes an
:class:`~evalkit.errors.EvalkitError` with their words, and a number that they return stands. The pivot entries are
given the poses of the chosen pose estimator, without the frames that have none, and return no covariance. The third
method of scikit-surgerycalibration, ``ransac``, is not listed: it draws from Python's global random numbers, and its
documentation calls it an exercise.
"""

# The tables of estimators import the modules of this folder, which import the tables' own packages: those come first.
import evalkit.pivot  # noqa: F401
