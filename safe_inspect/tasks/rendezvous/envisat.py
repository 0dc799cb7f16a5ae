"""Inertia of Envisat in its model frame M at full scale, and boxes that cover it.

Sources:
    Inertia as published for the e.Deorbit studies; sizes from public drawings, rounded.
"""

from __future__ import annotations

from safe_inspect.tasks.rendezvous.shape import TargetBox

#: Inertia about the centre of mass [kg m^2].
ENVISAT_INERTIA = ((17023.3, 397.1, -2171.4), (397.1, 124825.7, 344.2), (-2171.4, 344.2, 129112.2))
#: Bus, solar array, boom and radar antenna.
ENVISAT_BOXES = (
    TargetBox(centre=(-1.14, 0.0, 0.0), half_size=(5.0, 1.375, 1.05)),
    TargetBox(centre=(12.9, 0.0, 0.0), half_size=(7.0, 2.5, 0.06), roll="22 deg"),
    TargetBox(centre=(4.88, 0.0, 0.0), half_size=(1.02, 0.15, 0.15)),
    TargetBox(centre=(-1.14, 0.0, -1.45), half_size=(5.0, 0.65, 0.10)),
)
