"""Five-fingered gloves as elastic shells.

A glove lies with the back of the hand uppermost, the opening towards +y and the fingers towards -y,
seams at z = 0, centred in x and y by the bounding box. The thumb of a right glove points to +x.
"""
