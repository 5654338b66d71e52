"""From an ordinary video of a face to head pose and control signals, without a trained network.

The method is that of Chai, Xiao & Hodgins, "Vision-based control of 3D facial animation", SCA 2003,
doi:10.2312/SCA03/193-206, with the cylinder tracker of Xiao, Moriyama, Kanade & Cohn (2003), doi:10.1002/ima.10048.
"""
