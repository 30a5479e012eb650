"""Hats as elastic shells: baseball caps and bowl hats.

They stand on their opening: z up, the lowest point at z = 0, centred in x and y by the bounding
box. A visor points to -y, towards the robots; "left" is at -x.
"""
