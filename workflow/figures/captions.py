# SPDX-License-Identifier: LGPL-3.0-or-later
"""Captions: what a figure shows and how it was computed."""

CAPTIONS = {
    "model": (
        "The mesh as computed, coloured by region; for a wheel on a rail the whole model, the "
        "wheelset on the rail, a cut at the contact with its cells, and the rail seat. "
        "Positions are those before any load."
    ),
    "placement": (
        "Wheel and rail as placed in the track before any load. The wheel is drawn by the "
        "points of it that can touch the rail, seen along the rail: with an angle of attack "
        "the flange comes ahead of the tread. (d) is the distance between the two, vertical "
        "and along the normal of the wheel, from the exact profiles."
    ),
    "footprints": (
        "Nodes in contact, a node counts if its normal force is not zero, at some of the "
        "outputs, at the places of the undeformed rail. Outlines enclose the tributary areas "
        "of the nodes. Blue: contact in one patch; red: in two. The lower panel is the "
        "running surface rolled out flat; lines are trails of the centres of normal force at "
        "every output."
    ),
    "cross_section": (
        "The deformed cells of wheel and rail cut across the track through each patch, at the "
        "output at which the lesser of two patches bears most, or the last one in contact. "
        "Arrows are the directions of the normal resultants; the contact angle is theirs to "
        "the vertical."
    ),
    "contact_nodes": (
        "Coordinates of the surface nodes of wheel and rail next to the section through each "
        "patch. (a) In the track, with the tangent of each patch and its angle to the "
        "horizontal. (b, c) In the frame of each patch, heights stretched: nodes in contact "
        "lie on, or by the penetration below, the facets of the other body."
    ),
    "patch_forces": (
        "Normal force, tangential force (the size of the vector sum), contact angle and area "
        "of each patch at every output; area is the sum of tributary areas. The static wheel "
        "load is the vertical contact force at the first output."
    ),
    "patch_means": (
        "Mean shear stress on the rail along and across the rolling direction in the frame of "
        "each patch (sum of nodal forces over sum of tributary areas), its angle θ from the "
        "negative longitudinal axis, and the creepages: rigid slip of wheel on rail at the "
        "patch over the rolling speed. Patches of one or two nodes are left out of the "
        "stresses."
    ),
    "adhesion": (
        "Nodes of each patch in its tangent plane, each as a rectangle of its tributary area. "
        "A node adheres if friction × normal force less tangential force exceeds ε, the given "
        "part of the largest nodal tangential force of the output. Times: the last output "
        "before a second patch, and the first, middle and last with two; with one patch, four "
        "over the run."
    ),
    "centre_line": (
        "Pressure, friction × pressure and shear stress at the nodes of the longitudinal row "
        "next to the centre of each patch. Where shear meets friction × pressure the surfaces "
        "slip. Stress is nodal force over tributary area."
    ),
    "shear_vectors": (
        "Shear stress on the lower body at each node of the patches, in their tangent planes. "
        "θ is the angle of the mean to the negative longitudinal axis."
    ),
    "energy": (
        "(a) Change of each energy since the start; dissipations and works are sums. The "
        "dashed sum less external work would be zero in exact arithmetic of the time "
        "stepping. (b) That sum over the largest energy exchanged so far."
    ),
    "history": (
        "Resultants of each contact at every output. Wide pale lines are closed forms: ρ c v "
        "A for a bar, the dead load, Hertz's impact, Carter's and Kalker's tangential force "
        "at the creepage that is imposed."
    ),
    "pressure": (
        "Nodal pressure (normal force over tributary area) at the last output in contact "
        "against Hertz under the same normal force; shear against Carter or Cattaneo and "
        "Mindlin under the same tangential force. Root mean squares are of the nodes within "
        "0.9 of the contact, over the largest value."
    ),
    "transition": (
        "A frame for each output, nothing between them. Above: the contact surface rolled out "
        "flat (for a wheel on a rail; else the plane of the first patch), cells coloured by "
        "pressure, arrows the shear on the lower body, cells that adhere outlined in green. "
        "Below: cut across the track through the patch that bears most; normal and tangential "
        "force of each patch."
    ),
}


def caption(name: str, otherwise: str = "") -> str:
    """Return the caption of a figure; what its function says of itself, if it has none here."""
    return CAPTIONS.get(name) or otherwise or name.replace("_", " ").capitalize() + "."
