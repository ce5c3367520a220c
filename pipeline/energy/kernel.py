"""The grasp energy and its gradient, fused into one Warp kernel that runs on a CPU core or a CUDA device.

One thread computes one grasp. Everything is expressed in the object frame. The gradient is derived by hand: each term
adds a force (the derivative of the energy by the position of a point riding on a link) to a wrench per link, and one
sweep from the fingertips to the palm turns the wrenches into derivatives by the 6 + J degrees of freedom

    0..2   position of the hand, object frame
    3..5   rotation about the hand's origin, axes of the hand frame (right-invariant: R' = R exp([w]))
    6..    independent joints in the order of the hand's ``joint_names``; what follows a joint adds to its derivative

Normals are constants in the gradient: letting it through them was measured not to help.

What makes it fast is what it does not compute. A hand part whose centre is farther from the object's surface than its
own circumradius cannot hold a surface point; object points lie in blocks of 32 with bounding spheres; so do the hand's
own points, link by link.

This module must not postpone the evaluation of annotations: Warp reads them as types.
"""

import warp as wp

from pipeline.records.energy_terms import index_of

TRANSLATION = 3  # degrees of freedom before the rotation
POSE = 6  # degrees of freedom before the joints

wp.set_module_options({"enable_backward": False, "max_unroll": 1})


@wp.struct
class HandArrays:
    """The hand, see ``pipeline.hand.model.Hand``; parts are its boxes and, last, its spheres (62 at most)."""

    link_count: int
    part_count: int
    parent: wp.array(dtype=int)
    joint: wp.array(dtype=int)
    multiplier: wp.array(dtype=float)  # of the joint's position; 1 but for links of coupled joints
    offset: wp.array(dtype=float)  # to be added to it
    slides: wp.array(dtype=int)  # 1 where the link slides along the axis, 0 where it turns
    follows: wp.array(dtype=int)  # 1 for links of coupled joints
    origin_rotation: wp.array(dtype=wp.mat33)
    origin_position: wp.array(dtype=wp.vec3)
    axis: wp.array(dtype=wp.vec3)
    lower: wp.array(dtype=float)
    upper: wp.array(dtype=float)
    part_link: wp.array(dtype=int)
    part_centre: wp.array(dtype=wp.vec3)  # link frame
    part_half: wp.array(dtype=wp.vec3)  # half extents; 0 for a sphere
    part_radius: wp.array(dtype=float)  # radius of a sphere, 0 for a box
    part_reach: wp.array(dtype=float)  # circumradius
    points: wp.array(dtype=wp.vec3)  # surface points in link frames, sorted into blocks
    block_start: wp.array(dtype=int)  # (blocks + 1,)
    block_centre: wp.array(dtype=wp.vec3)
    block_radius: wp.array(dtype=float)
    link_block: wp.array(dtype=int)  # (links + 1,) first block of a link
    link_centre: wp.array(dtype=wp.vec3)  # bounding sphere of the link's points
    link_radius: wp.array(dtype=float)
    link_other: wp.array(dtype=int)  # (links + 1,) first entry of a link in other_part
    other_part: wp.array(dtype=int)  # parts that are neither on the link nor on a neighbour
    mount_points: wp.array(dtype=wp.vec3)  # hand frame
    mount_count: int
    mount_centre: wp.vec3
    mount_radius: float
    keep_out_points: wp.array(dtype=wp.vec3)  # hand frame, sorted into blocks
    keep_out_start: wp.array(dtype=int)
    keep_out_centre: wp.array(dtype=wp.vec3)
    keep_out_radius: wp.array(dtype=float)
    keep_out_blocks: int
    own_part: wp.array(dtype=int)  # parts of the fingers that must stay out
    own_count: int
    contact_link: wp.array(dtype=int)
    contact_point: wp.array(dtype=wp.vec3)
    contact_opposes: wp.array(dtype=int)  # 1 for the opposing fingers (thumb, palm), 0 for the fingers that they oppose


@wp.struct
class ObjectArrays:
    """The object: signed-distance grid and surface points sorted into blocks."""

    distance: wp.array(dtype=float, ndim=3)
    distance_origin: wp.vec3
    distance_spacing: float
    padding: float  # least distance of the object to the border of the grid
    points: wp.array(dtype=wp.vec3)
    block_start: wp.array(dtype=int)
    block_centre: wp.array(dtype=wp.vec3)
    block_radius: wp.array(dtype=float)
    block_count: int
    torque_scale: float  # 1/m
    table_height: float  # z that the hand's points should stay above
    mount_height: float  # z that flange and mount should stay above
    keep_out_margin: float  # least distance to keep-out points


@wp.struct
class Weights:
    """Weights of the terms."""

    force_closure: float
    distance: float
    penetration: float
    self_penetration: float
    joints: float
    offset: float
    balance_forces: int


@wp.struct
class States:
    """Grasps with their energies; the first index is the chain."""

    position: wp.array(dtype=wp.vec3)
    rotation: wp.array(dtype=wp.quat)
    q: wp.array(dtype=float, ndim=2)
    contacts: wp.array(dtype=int, ndim=2)
    terms: wp.array(dtype=float, ndim=2)
    energy: wp.array(dtype=float)
    gradient: wp.array(dtype=float, ndim=2)


@wp.struct
class Scratch:
    """Working memory of one thread per row."""

    rotation: wp.array(dtype=wp.mat33, ndim=2)  # of links
    position: wp.array(dtype=wp.vec3, ndim=2)
    force: wp.array(dtype=wp.vec3, ndim=2)  # on links, derivative of the energy by a translation
    moment: wp.array(dtype=wp.vec3, ndim=2)  # about the object's origin
    part_position: wp.array(dtype=wp.vec3, ndim=2)
    near: wp.array(dtype=int, ndim=2)  # parts that need a closer look
    normal: wp.array(dtype=wp.vec3, ndim=2)  # at contacts


@wp.struct
class Schedule:
    """How chains move; see ``pipeline.synthesize.chains``."""

    step: float
    step_decay: float
    step_period: float
    temperature: float
    temperature_decay: float
    temperature_period: float
    switch_probability: float
    noise: float
    memory: float
    shared: int  # 1: row 0 of the mean squares is for all chains, see share_slopes_kernel
    repeats: int  # 1: two contacts may be the same candidate
    free: wp.array(dtype=float)  # (6 + J,) 1 where a degree of freedom may move
    slot_start: wp.array(dtype=int)  # (contacts + 1,)
    slot_candidate: wp.array(dtype=int)  # candidates of each contact
    slot_cumulative: wp.array(dtype=float)  # their cumulative probability


@wp.func
def rough_distance(scene: ObjectArrays, p: wp.vec3):
    """Return the signed distance at the nearest node of the grid; outside of the grid, a lower bound."""
    x = (p - scene.distance_origin) / scene.distance_spacing
    top = wp.vec3(
        float(scene.distance.shape[0] - 1), float(scene.distance.shape[1] - 1), float(scene.distance.shape[2] - 1)
    )
    c = wp.max(wp.min(x, top), wp.vec3(0.0, 0.0, 0.0))
    value = scene.distance[int(c[0] + 0.5), int(c[1] + 0.5), int(c[2] + 0.5)]
    beyond = wp.length(x - c) * scene.distance_spacing
    if beyond > 0.0:
        value = wp.max(beyond + scene.padding, value - beyond)
    return value


@wp.func
def nearest_distance(scene: ObjectArrays, p: wp.vec3):
    """Return a lower bound (up to half a cell's diagonal) of the distance to the surface, unsigned."""
    return wp.abs(rough_distance(scene, p)) - scene.distance_spacing


@wp.func
def trilinear_distance(scene: ObjectArrays, p: wp.vec3):
    """Return signed distance and its gradient; beyond the grid, the distance to the grid is added."""
    x = (p - scene.distance_origin) / scene.distance_spacing
    nx = scene.distance.shape[0]
    ny = scene.distance.shape[1]
    nz = scene.distance.shape[2]
    c = wp.max(wp.min(x, wp.vec3(float(nx - 1), float(ny - 1), float(nz - 1))), wp.vec3(0.0, 0.0, 0.0))
    i = wp.min(int(c[0]), nx - 2)
    j = wp.min(int(c[1]), ny - 2)
    k = wp.min(int(c[2]), nz - 2)
    u = c[0] - float(i)
    v = c[1] - float(j)
    w = c[2] - float(k)
    d000 = scene.distance[i, j, k]
    d001 = scene.distance[i, j, k + 1]
    d010 = scene.distance[i, j + 1, k]
    d011 = scene.distance[i, j + 1, k + 1]
    d100 = scene.distance[i + 1, j, k]
    d101 = scene.distance[i + 1, j, k + 1]
    d110 = scene.distance[i + 1, j + 1, k]
    d111 = scene.distance[i + 1, j + 1, k + 1]
    d00 = d000 + w * (d001 - d000)
    d01 = d010 + w * (d011 - d010)
    d10 = d100 + w * (d101 - d100)
    d11 = d110 + w * (d111 - d110)
    d0 = d00 + v * (d01 - d00)
    d1 = d10 + v * (d11 - d10)
    value = d0 + u * (d1 - d0)
    z0 = (d001 - d000) + v * ((d011 - d010) - (d001 - d000))
    z1 = (d101 - d100) + v * ((d111 - d110) - (d101 - d100))
    gradient = wp.vec3(d1 - d0, (d01 - d00) + u * ((d11 - d10) - (d01 - d00)), z0 + u * (z1 - z0))
    gradient = gradient / scene.distance_spacing
    outside = x - c
    beyond = wp.length(outside)
    if beyond > 0.0:
        # Clamped coordinates no longer change the grid's value.
        direction = outside / beyond
        for axis in range(3):
            if outside[axis] != 0.0:
                gradient[axis] = 0.0
        gradient = gradient + direction
        value = value + beyond * scene.distance_spacing
    return value, gradient


@wp.func
def depth_in_part(hand: HandArrays, part: int, x: wp.vec3):
    """Return how deep ``x`` (frame of the part) lies inside a part; negative outside, where it need not be exact."""
    radius = hand.part_radius[part]
    if radius > 0.0:
        return radius - wp.length(x)
    half = hand.part_half[part]
    return wp.min(half[0] - wp.abs(x[0]), wp.min(half[1] - wp.abs(x[1]), half[2] - wp.abs(x[2])))


@wp.func
def push_of_part(hand: HandArrays, part: int, x: wp.vec3):
    """Return the derivative of the depth by a translation of the part, frame of the part."""
    if hand.part_radius[part] > 0.0:
        return wp.normalize(x)
    half = hand.part_half[part]
    a = half[0] - wp.abs(x[0])
    b = half[1] - wp.abs(x[1])
    c = half[2] - wp.abs(x[2])
    if a <= b and a <= c:
        return wp.vec3(wp.sign(x[0]), 0.0, 0.0)
    if b <= c:
        return wp.vec3(0.0, wp.sign(x[1]), 0.0)
    return wp.vec3(0.0, 0.0, wp.sign(x[2]))


@wp.func
def sphere_reaches_part(hand: HandArrays, part: int, x: wp.vec3, radius: float):
    """Whether a sphere about ``x`` (frame of the part) touches the part."""
    half = hand.part_half[part]
    gap = wp.vec3(
        wp.max(wp.abs(x[0]) - half[0], 0.0), wp.max(wp.abs(x[1]) - half[1], 0.0), wp.max(wp.abs(x[2]) - half[2], 0.0)
    )
    reach = radius + hand.part_radius[part]
    return wp.dot(gap, gap) < reach * reach


@wp.func
def add_force(scratch: Scratch, chain: int, link: int, p: wp.vec3, force: wp.vec3):
    """Add the derivative of the energy by the position of a point ``p`` that rides on a link."""
    scratch.force[chain, link] = scratch.force[chain, link] + force
    scratch.moment[chain, link] = scratch.moment[chain, link] + wp.cross(p, force)


@wp.func
def place_links(hand: HandArrays, states: States, scratch: Scratch, chain: int):
    """Forward kinematics; clears the wrenches."""
    for link in range(hand.link_count):
        parent = hand.parent[link]
        if parent < 0:
            scratch.rotation[chain, link] = wp.quat_to_matrix(states.rotation[chain])
            scratch.position[chain, link] = states.position[chain]
        else:
            R = scratch.rotation[chain, parent]
            scratch.position[chain, link] = scratch.position[chain, parent] + R @ hand.origin_position[link]
            R = R @ hand.origin_rotation[link]
            joint = hand.joint[link]
            if joint >= 0:
                value = hand.multiplier[link] * states.q[chain, joint] + hand.offset[link]
                a = hand.axis[link]
                if hand.slides[link] > 0:
                    scratch.position[chain, link] = scratch.position[chain, link] + R @ (a * value)
                else:
                    s = wp.sin(value)
                    c = wp.cos(value)
                    K = wp.skew(a)
                    R = R @ (wp.identity(n=3, dtype=float) * c + K * s + wp.outer(a, a) * (1.0 - c))
            scratch.rotation[chain, link] = R
        scratch.force[chain, link] = wp.vec3(0.0, 0.0, 0.0)
        scratch.moment[chain, link] = wp.vec3(0.0, 0.0, 0.0)
    for part in range(hand.part_count):
        link = hand.part_link[part]
        scratch.part_position[chain, part] = (
            scratch.position[chain, link] + scratch.rotation[chain, link] @ hand.part_centre[part]
        )


@wp.func
def contact_terms(
    hand: HandArrays, scene: ObjectArrays, weights: Weights, states: States, scratch: Scratch, chain: int
):
    """Force closure, distance and offset of the contacts."""
    count = states.contacts.shape[1]
    opposing = float(0.0)
    for slot in range(count):
        opposing += float(hand.contact_opposes[states.contacts[chain, slot]])
    others = float(count) - opposing
    share = float(1.0)
    share_others = float(1.0)
    if weights.balance_forces > 0 and opposing > 0.0 and others > 0.0:
        share = 0.5 * float(count) / opposing
        share_others = 0.5 * float(count) / others
    force = wp.vec3(0.0, 0.0, 0.0)
    torque = wp.vec3(0.0, 0.0, 0.0)
    distance = float(0.0)
    centre = wp.vec3(0.0, 0.0, 0.0)
    for slot in range(count):
        candidate = states.contacts[chain, slot]
        link = hand.contact_link[candidate]
        p = scratch.position[chain, link] + scratch.rotation[chain, link] @ hand.contact_point[candidate]
        value, gradient = trilinear_distance(scene, p)
        distance += wp.abs(value)
        add_force(scratch, chain, link, p, gradient * (wp.sign(value) * weights.distance))
        normal = wp.normalize(gradient)
        if hand.contact_opposes[candidate] > 0:
            normal = normal * share
            centre += p * (share / float(count))
        else:
            normal = normal * share_others
            centre += p * (share_others / float(count))
        scratch.normal[chain, slot] = normal
        force += normal
        torque += wp.cross(p, normal)
    torque = torque * scene.torque_scale
    closure = wp.dot(force, force) + wp.dot(torque, torque)
    scale = 2.0 * weights.force_closure * scene.torque_scale
    for slot in range(count):
        candidate = states.contacts[chain, slot]
        link = hand.contact_link[candidate]
        p = scratch.position[chain, link] + scratch.rotation[chain, link] @ hand.contact_point[candidate]
        part = share_others
        if hand.contact_opposes[candidate] > 0:
            part = share
        pull = centre * (2.0 * weights.offset * part / float(count))
        add_force(scratch, chain, link, p, wp.cross(scratch.normal[chain, slot], torque) * scale + pull)
    offset = wp.dot(centre, centre)
    states.terms[chain, wp.static(index_of("force_closure"))] = closure
    states.terms[chain, wp.static(index_of("distance"))] = distance
    states.terms[chain, wp.static(index_of("offset"))] = offset
    return weights.force_closure * closure + weights.distance * distance + weights.offset * offset


@wp.func
def sphere_reaches(hand: HandArrays, scratch: Scratch, chain: int, part: int, centre: wp.vec3, radius: float):
    """Whether a sphere, object frame, touches a part where the grasp has it; bounding spheres are tried first."""
    d = centre - scratch.part_position[chain, part]
    reach = radius + hand.part_reach[part]
    if wp.dot(d, d) >= reach * reach:
        return False
    x = wp.transpose(scratch.rotation[chain, hand.part_link[part]]) @ d
    return sphere_reaches_part(hand, part, x, radius)


@wp.func
def reached_parts(hand: HandArrays, scratch: Scratch, chain: int, near: int, centre: wp.vec3, radius: float):
    """Bit mask of those of the first ``near`` parts in ``scratch.near`` that a sphere, object frame, touches."""
    mask = wp.int64(0)
    for index in range(near):
        if sphere_reaches(hand, scratch, chain, scratch.near[chain, index], centre, radius):
            mask = mask | (wp.int64(1) << wp.int64(index))
    return mask


@wp.func
def deepest_part(hand: HandArrays, scratch: Scratch, chain: int, near: int, mask: wp.int64, p: wp.vec3):
    """Return the part of ``mask`` that the point is deepest in (-1: in none), and how deep."""
    deepest = float(0.0)
    where = int(-1)
    for index in range(near):
        if (mask & (wp.int64(1) << wp.int64(index))) != wp.int64(0):
            part = scratch.near[chain, index]
            d = p - scratch.part_position[chain, part]
            x = wp.transpose(scratch.rotation[chain, hand.part_link[part]]) @ d
            depth = depth_in_part(hand, part, x)
            if depth > deepest:
                deepest = depth
                where = part
    return where, deepest


@wp.func
def penetration_term(hand: HandArrays, scene: ObjectArrays, weight: float, scratch: Scratch, chain: int):
    """Sum over the object's points of their depth in the deepest part of the hand."""
    near = int(0)
    for part in range(hand.part_count):
        if nearest_distance(scene, scratch.part_position[chain, part]) < hand.part_reach[part]:
            scratch.near[chain, near] = part
            near += 1
    total = float(0.0)
    if near > 0:
        for block in range(scene.block_count):
            centre = scene.block_centre[block]
            radius = scene.block_radius[block]
            mask = reached_parts(hand, scratch, chain, near, centre, radius)
            if mask != wp.int64(0):
                for point in range(scene.block_start[block], scene.block_start[block + 1]):
                    p = scene.points[point]
                    where, deepest = deepest_part(hand, scratch, chain, near, mask, p)
                    if where >= 0:
                        total += deepest
                        link = hand.part_link[where]
                        R = scratch.rotation[chain, link]
                        x = wp.transpose(R) @ (p - scratch.part_position[chain, where])
                        add_force(scratch, chain, link, p, R @ push_of_part(hand, where, x) * weight)
    return total


@wp.func
def table_term(hand: HandArrays, scene: ObjectArrays, weight: float, scratch: Scratch, chain: int):
    """Sum over points of hand and mount of their depth below the heights that they should keep."""
    total = float(0.0)
    for link in range(hand.link_count):
        R = scratch.rotation[chain, link]
        t = scratch.position[chain, link]
        c = hand.link_centre[link]
        height = t[2] + R[2, 0] * c[0] + R[2, 1] * c[1] + R[2, 2] * c[2]
        if height - hand.link_radius[link] < scene.table_height:
            first = hand.block_start[hand.link_block[link]]
            last = hand.block_start[hand.link_block[link + 1]]
            for point in range(first, last):
                p = t + R @ hand.points[point]
                depth = scene.table_height - p[2]
                if depth > 0.0:
                    total += depth
                    add_force(scratch, chain, link, p, wp.vec3(0.0, 0.0, -weight))
    if hand.mount_count > 0:
        R = scratch.rotation[chain, 0]
        t = scratch.position[chain, 0]
        c = t + R @ hand.mount_centre
        if c[2] - hand.mount_radius < scene.mount_height:
            for point in range(hand.mount_count):
                p = t + R @ hand.mount_points[point]
                depth = scene.mount_height - p[2]
                if depth > 0.0:
                    total += depth
                    add_force(scratch, chain, 0, p, wp.vec3(0.0, 0.0, -weight))
    return total


@wp.func
def self_penetration_term(hand: HandArrays, weight: float, scratch: Scratch, chain: int):
    """Sum over the hand's points of their depth in the deepest part that is not on their link or a neighbour."""
    total = float(0.0)
    for link in range(hand.link_count):
        R = scratch.rotation[chain, link]
        t = scratch.position[chain, link]
        c = t + R @ hand.link_centre[link]
        near = int(0)
        for entry in range(hand.link_other[link], hand.link_other[link + 1]):
            part = hand.other_part[entry]
            if sphere_reaches(hand, scratch, chain, part, c, hand.link_radius[link]):
                scratch.near[chain, near] = part
                near += 1
        if near > 0:
            for block in range(hand.link_block[link], hand.link_block[link + 1]):
                centre = t + R @ hand.block_centre[block]
                radius = hand.block_radius[block]
                mask = reached_parts(hand, scratch, chain, near, centre, radius)
                if mask != wp.int64(0):
                    for point in range(hand.block_start[block], hand.block_start[block + 1]):
                        p = t + R @ hand.points[point]
                        where, deepest = deepest_part(hand, scratch, chain, near, mask, p)
                        if where >= 0:
                            total += deepest
                            other = hand.part_link[where]
                            Q = scratch.rotation[chain, other]
                            x = wp.transpose(Q) @ (p - scratch.part_position[chain, where])
                            force = Q @ push_of_part(hand, where, x) * weight
                            add_force(scratch, chain, other, p, force)
                            add_force(scratch, chain, link, p, -force)
    return total


@wp.func
def keep_out_term(hand: HandArrays, scene: ObjectArrays, weight: float, scratch: Scratch, chain: int):
    """Sum over the keep-out points of their depth in the object with its margin, and in the style's own fingers."""
    total = float(0.0)
    R = scratch.rotation[chain, 0]
    t = scratch.position[chain, 0]
    for index in range(hand.own_count):
        scratch.near[chain, index] = hand.own_part[index]
    for block in range(hand.keep_out_blocks):
        centre = t + R @ hand.keep_out_centre[block]
        radius = hand.keep_out_radius[block]
        reach = radius + scene.keep_out_margin + scene.distance_spacing
        near_object = rough_distance(scene, centre) < reach
        mask = reached_parts(hand, scratch, chain, hand.own_count, centre, radius)
        if near_object or mask != wp.int64(0):
            for point in range(hand.keep_out_start[block], hand.keep_out_start[block + 1]):
                p = t + R @ hand.keep_out_points[point]
                if near_object:
                    value, gradient = trilinear_distance(scene, p)
                    depth = scene.keep_out_margin - value
                    if depth > 0.0:
                        total += depth
                        add_force(scratch, chain, 0, p, gradient * (-weight))
                if mask != wp.int64(0):
                    where, deepest = deepest_part(hand, scratch, chain, hand.own_count, mask, p)
                    if where >= 0:
                        total += deepest
                        link = hand.part_link[where]
                        Q = scratch.rotation[chain, link]
                        x = wp.transpose(Q) @ (p - scratch.part_position[chain, where])
                        force = Q @ push_of_part(hand, where, x) * weight
                        add_force(scratch, chain, link, p, force)
                        add_force(scratch, chain, 0, p, -force)
    return total


@wp.func
def compute_energy(
    hand: HandArrays, scene: ObjectArrays, weights: Weights, states: States, scratch: Scratch, chain: int
):
    """Write terms, energy and gradient of one grasp."""
    place_links(hand, states, scratch, chain)
    energy = contact_terms(hand, scene, weights, states, scratch, chain)
    penetration = penetration_term(hand, scene, weights.penetration, scratch, chain)
    table = table_term(hand, scene, weights.penetration, scratch, chain)
    collision = self_penetration_term(hand, weights.self_penetration, scratch, chain)
    keep_out = keep_out_term(hand, scene, weights.penetration, scratch, chain)
    excess = float(0.0)
    for degree in range(wp.static(POSE), states.gradient.shape[1]):
        states.gradient[chain, degree] = 0.0
    for index in range(hand.link_count - 1):
        # Children come after their parents, so that each link is complete when its wrench is passed on.
        link = hand.link_count - 1 - index
        force = scratch.force[chain, link]
        moment = scratch.moment[chain, link]
        joint = hand.joint[link]
        if joint >= 0:
            axis = scratch.rotation[chain, link] @ hand.axis[link]
            slope = wp.dot(axis, moment - wp.cross(scratch.position[chain, link], force))
            if hand.slides[link] > 0:
                slope = wp.dot(axis, force)
            slope = slope * hand.multiplier[link]
            if hand.follows[link] == 0:
                value = states.q[chain, joint]
                above = value - hand.upper[joint]
                below = hand.lower[joint] - value
                if above > 0.0:
                    excess += above
                    slope += weights.joints
                if below > 0.0:
                    excess += below
                    slope -= weights.joints
            degree = wp.static(POSE) + joint
            states.gradient[chain, degree] = states.gradient[chain, degree] + slope
        parent = hand.parent[link]
        scratch.force[chain, parent] = scratch.force[chain, parent] + force
        scratch.moment[chain, parent] = scratch.moment[chain, parent] + moment
    force = scratch.force[chain, 0]
    moment = scratch.moment[chain, 0] - wp.cross(scratch.position[chain, 0], force)
    moment = wp.transpose(scratch.rotation[chain, 0]) @ moment
    for axis in range(3):
        states.gradient[chain, axis] = force[axis]
        states.gradient[chain, wp.static(TRANSLATION) + axis] = moment[axis]
    states.terms[chain, wp.static(index_of("penetration"))] = penetration
    states.terms[chain, wp.static(index_of("table"))] = table
    states.terms[chain, wp.static(index_of("self_penetration"))] = collision
    states.terms[chain, wp.static(index_of("joints"))] = excess
    states.terms[chain, wp.static(index_of("keep_out"))] = keep_out
    states.energy[chain] = (
        energy
        + weights.penetration * (penetration + table + keep_out)
        + weights.self_penetration * collision
        + weights.joints * excess
    )


@wp.func
def copy_state(source: States, target: States, chain: int):
    """Copy one grasp with everything known about it."""
    target.position[chain] = source.position[chain]
    target.rotation[chain] = source.rotation[chain]
    for joint in range(source.q.shape[1]):
        target.q[chain, joint] = source.q[chain, joint]
    for slot in range(source.contacts.shape[1]):
        target.contacts[chain, slot] = source.contacts[chain, slot]
    for term in range(source.terms.shape[1]):
        target.terms[chain, term] = source.terms[chain, term]
    for degree in range(source.gradient.shape[1]):
        target.gradient[chain, degree] = source.gradient[chain, degree]
    target.energy[chain] = source.energy[chain]


@wp.func
def propose(
    schedule: Schedule,
    current: States,
    proposal: States,
    mean_square: wp.array(dtype=float, ndim=2),
    chain: int,
    seed: int,
    iteration: int,
):
    """Write a proposal. Random numbers depend on the chain's seed and the iteration only."""
    random = wp.rand_init(seed, iteration)
    wp.randf(random)  # the number that decides on the acceptance
    step = schedule.step * wp.pow(schedule.step_decay, wp.floor(float(iteration) / schedule.step_period))
    unbias = 1.0 / (1.0 - wp.pow(schedule.memory, float(iteration + 1)))
    turn = wp.vec3(0.0, 0.0, 0.0)
    move = wp.vec3(0.0, 0.0, 0.0)
    for degree in range(current.gradient.shape[1]):
        slope = current.gradient[chain, degree]
        square = mean_square[0, degree]
        if schedule.shared == 0:
            square = schedule.memory * mean_square[chain, degree] + (1.0 - schedule.memory) * slope * slope
            mean_square[chain, degree] = square
            square = square * unbias
        change = -slope / wp.sqrt(square + 1.0e-6) + schedule.noise * wp.randn(random)
        change = change * step * schedule.free[degree]
        if degree < wp.static(TRANSLATION):
            move[degree] = change
        elif degree < wp.static(POSE):
            turn[degree - wp.static(TRANSLATION)] = change
        else:
            joint = degree - wp.static(POSE)
            proposal.q[chain, joint] = current.q[chain, joint] + change
    proposal.position[chain] = current.position[chain] + move
    angle = wp.length(turn)
    rotation = current.rotation[chain]
    if angle > 0.0:
        rotation = wp.normalize(rotation * wp.quat_from_axis_angle(turn / angle, angle))
    proposal.rotation[chain] = rotation
    count = current.contacts.shape[1]
    for slot in range(count):
        candidate = current.contacts[chain, slot]
        if wp.randf(random) < schedule.switch_probability:
            draw = wp.randf(random)
            entry = schedule.slot_start[slot]
            while entry < schedule.slot_start[slot + 1] - 1 and schedule.slot_cumulative[entry] <= draw:
                entry += 1
            candidate = schedule.slot_candidate[entry]
        proposal.contacts[chain, slot] = candidate


@wp.func
def is_allowed(schedule: Schedule, proposal: States, chain: int):
    """Whether no contact of a proposal is used twice, or that does not matter."""
    if schedule.repeats > 0:
        return True
    for slot in range(proposal.contacts.shape[1]):
        for other in range(slot):
            if proposal.contacts[chain, slot] == proposal.contacts[chain, other]:
                return False
    return True


@wp.func
def decide(schedule: Schedule, current: States, proposal: States, best: States, chain: int, seed: int, iteration: int):
    """Metropolis' rule: the proposal becomes the current state, and the best one if it is."""
    accept = wp.randf(wp.rand_init(seed, iteration))
    temperature = schedule.temperature * wp.pow(
        schedule.temperature_decay, wp.floor(float(iteration + 1) / schedule.temperature_period)
    )
    if accept < wp.exp((current.energy[chain] - proposal.energy[chain]) / temperature):
        copy_state(proposal, current, chain)
        if proposal.energy[chain] < best.energy[chain]:
            copy_state(proposal, best, chain)


@wp.kernel
def evaluate_kernel(hand: HandArrays, scene: ObjectArrays, weights: Weights, states: States, scratch: Scratch):
    """Terms, energy and gradient of every grasp."""
    compute_energy(hand, scene, weights, states, scratch, wp.tid())


@wp.kernel
def anneal_kernel(
    hand: HandArrays,
    scene: ObjectArrays,
    weights: Weights,
    schedule: Schedule,
    current: States,
    proposal: States,
    best: States,
    scratch: Scratch,
    mean_square: wp.array(dtype=float, ndim=2),
    seeds: wp.array(dtype=int),
    iterations: int,
):
    """Run every chain: Metropolis-adjusted Langevin steps with contact switches.

    ``current`` must carry its energy and gradient; ``best`` keeps the state of lowest energy.
    """
    chain = wp.tid()
    for iteration in range(iterations):
        propose(schedule, current, proposal, mean_square, chain, seeds[chain], iteration)
        if is_allowed(schedule, proposal, chain):
            compute_energy(hand, scene, weights, proposal, scratch, chain)
            decide(schedule, current, proposal, best, chain, seeds[chain], iteration)


# The same in steps, for chains of a batch that influence each other.


@wp.kernel
def share_slopes_kernel(schedule: Schedule, current: States, mean_square: wp.array(dtype=float, ndim=2)):
    """Update row 0 of the mean squares with the batch's mean; one thread per degree of freedom."""
    degree = wp.tid()
    total = float(0.0)
    for chain in range(current.energy.shape[0]):
        slope = current.gradient[chain, degree]
        total += slope * slope
    mean = total / float(current.energy.shape[0])
    mean_square[0, degree] = schedule.memory * mean_square[0, degree] + (1.0 - schedule.memory) * mean


@wp.kernel
def propose_kernel(
    hand: HandArrays,
    scene: ObjectArrays,
    weights: Weights,
    schedule: Schedule,
    current: States,
    proposal: States,
    scratch: Scratch,
    mean_square: wp.array(dtype=float, ndim=2),
    seeds: wp.array(dtype=int),
    iteration: int,
):
    """Proposals and their energies, one thread per chain."""
    chain = wp.tid()
    propose(schedule, current, proposal, mean_square, chain, seeds[chain], iteration)
    compute_energy(hand, scene, weights, proposal, scratch, chain)


@wp.kernel
def decide_kernel(
    schedule: Schedule, current: States, proposal: States, best: States, seeds: wp.array(dtype=int), iteration: int
):
    """Metropolis' rule, one thread per chain."""
    chain = wp.tid()
    if is_allowed(schedule, proposal, chain):
        decide(schedule, current, proposal, best, chain, seeds[chain], iteration)
