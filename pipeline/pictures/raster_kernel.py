"""Coloured meshes to pictures by rasterising them, in Warp, on the CPU: what films are drawn with.

The look is that of ``pictures.render``, which casts rays. Every pixel has SUBSAMPLES x SUBSAMPLES samples. Faces are
first drawn as seen from the light, which gives the heights that cast shadows, then as seen from the camera; then
every pixel is shaded: once where all of its samples show the same face, or none, and otherwise each sample. Shadows are
soft in proportion to the height of what casts them above what they fall on.

``cover`` runs as one thread: faces are drawn one after the other, so the same scene gives the same bytes.
This module must not postpone the evaluation of annotations: Warp reads them as types.
"""

import warp as wp

from pipeline.pictures.render import AMBIENT, FLOOR, GLOSS, KEY, SKY

SUBSAMPLES = 2
SHADOW_SIZE = 768  # samples along an edge of what the light sees
CELL = 16  # samples along an edge of a cell of what the light sees; more than SEARCH
CELLS = SHADOW_SIZE // CELL
TAPS = 8  # places of the shadow looked at, twice
SEARCH = 0.012  # m, within which a sample looks for what casts a shadow on it
BIAS = 0.004  # m, by which what casts a shadow lies above what it falls on
LIFT = 0.002  # m, along the normal, from where the light is looked for
NEAR = 0.05  # m; what is nearer to the camera is not drawn
GOLDEN_ANGLE = 2.3999632
SKY_COLOUR = wp.constant(wp.vec3(*SKY.tolist()))
FLOOR_COLOUR = wp.constant(wp.vec3(*FLOOR.tolist()))

wp.set_module_options({"enable_backward": False, "max_unroll": 4})


@wp.struct
class Scene:
    """Meshes of all bodies one after the other, and where the bodies are."""

    vertices: wp.array(dtype=wp.vec3)  # m, in the frame of their body
    vertex_body: wp.array(dtype=int)
    faces: wp.array(dtype=wp.vec3i)
    face_body: wp.array(dtype=int)
    normals: wp.array2d(dtype=wp.vec3)  # (faces, 3) at the corners, in the frame of their body
    colours: wp.array(dtype=wp.vec3)  # of bodies, linear light
    T: wp.array(dtype=wp.mat44)  # T_world_body
    floor: float  # m, height of the plane below


@wp.struct
class View:
    """A pinhole camera; the picture is in samples."""

    position: wp.vec3
    right: wp.vec3
    down: wp.vec3
    forward: wp.vec3
    focal: float
    width: int
    height: int


@wp.struct
class Light:
    """A distant round light, and the square that it looks at."""

    right: wp.vec3
    up: wp.vec3
    towards: wp.vec3  # the light, of unit length
    centre: wp.vec3
    scale: float  # samples per metre
    spread: float  # radius of the light, as a slope
    around: wp.array(dtype=float)  # what ``highest_around`` wrote
    taps: wp.array(dtype=wp.vec2)  # (TAPS,) places spread over a disc of radius 1


@wp.kernel
def place(
    scene: Scene,
    view: View,
    light: Light,
    seen: wp.array(dtype=wp.vec3),
    lit: wp.array(dtype=wp.vec3),
):
    """Write where every vertex is in the picture and under the light: x, y (samples), and what grows towards both."""
    k = wp.tid()
    world = wp.transform_point(scene.T[scene.vertex_body[k]], scene.vertices[k])
    local = world - view.position
    depth = wp.dot(local, view.forward)
    near = 1.0 / wp.max(depth, NEAR)
    if depth < NEAR:
        near = -1.0
    x = wp.dot(local, view.right) * near * view.focal + 0.5 * float(view.width)
    y = wp.dot(local, view.down) * near * view.focal + 0.5 * float(view.height)
    seen[k] = wp.vec3(x, y, near)
    off = world - light.centre
    half = 0.5 * float(SHADOW_SIZE)
    lit[k] = wp.vec3(
        wp.dot(off, light.right) * light.scale + half,
        wp.dot(off, light.up) * light.scale + half,
        wp.dot(off, light.towards),
    )


@wp.kernel
def cover(
    points: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    width: int,
    height: int,
    least: float,
    highest: wp.array(dtype=float),
    owner: wp.array(dtype=int),
):
    """Write for every sample the third coordinate of the highest face there, and which face that is.

    Faces with a corner whose third coordinate is below ``least`` are left out.
    """
    for k in range(faces.shape[0]):
        corners = faces[k]
        a = points[corners[0]]
        b = points[corners[1]]
        c = points[corners[2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if wp.abs(area) > 1.0e-9 and wp.min(wp.min(a[2], b[2]), c[2]) > least:
            left = wp.max(int(wp.ceil(wp.min(wp.min(a[0], b[0]), c[0]) - 0.5)), 0)
            right = wp.min(int(wp.floor(wp.max(wp.max(a[0], b[0]), c[0]) - 0.5)), width - 1)
            top = wp.max(int(wp.ceil(wp.min(wp.min(a[1], b[1]), c[1]) - 0.5)), 0)
            bottom = wp.min(int(wp.floor(wp.max(wp.max(a[1], b[1]), c[1]) - 0.5)), height - 1)
            per_area = 1.0 / area
            for row in range(top, bottom + 1):
                y = float(row) + 0.5
                for column in range(left, right + 1):
                    x = float(column) + 0.5
                    u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) * per_area
                    v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) * per_area
                    w = 1.0 - u - v
                    if u >= 0.0 and v >= 0.0 and w >= 0.0:
                        z = u * a[2] + v * b[2] + w * c[2]
                        sample = row * width + column
                        if z > highest[sample]:
                            highest[sample] = z
                            owner[sample] = k


@wp.kernel
def highest_of_cells(highest: wp.array(dtype=float), cells: wp.array(dtype=float)):
    """Write how high the highest face of every cell is under the light."""
    cell = wp.tid()
    row = cell // CELLS * CELL
    column = cell % CELLS * CELL
    found = float(-1.0e3)
    for i in range(row, row + CELL):
        for j in range(column, column + CELL):
            found = wp.max(found, highest[i * SHADOW_SIZE + j])
    cells[cell] = found


@wp.kernel
def highest_around(cells: wp.array(dtype=float), around: wp.array(dtype=float)):
    """Write how high the highest face of every cell and its neighbours is."""
    cell = wp.tid()
    found = float(-1.0e3)
    for i in range(wp.max(cell // CELLS - 1, 0), wp.min(cell // CELLS + 2, CELLS)):
        for j in range(wp.max(cell % CELLS - 1, 0), wp.min(cell % CELLS + 2, CELLS)):
            found = wp.max(found, cells[i * CELLS + j])
    around[cell] = found


@wp.func
def height_at(highest: wp.array(dtype=float), x: float, y: float):
    """Return how high the highest face is under the light; far below where there is none."""
    column = int(wp.floor(x))
    row = int(wp.floor(y))
    found = float(-1.0e3)
    if column >= 0 and row >= 0 and column < SHADOW_SIZE and row < SHADOW_SIZE:
        found = highest[row * SHADOW_SIZE + column]
    return found


@wp.func
def highest_near(light: Light, x: float, y: float):
    """Return a height that no face near a place under the light exceeds."""
    row = wp.clamp(int(y) // CELL, 0, CELLS - 1)
    column = wp.clamp(int(x) // CELL, 0, CELLS - 1)
    return light.around[row * CELLS + column]


@wp.func
def under_light(light: Light, point: wp.vec3):
    """Return where a point is under the light: x, y (samples), and above which height a face casts a shadow on it."""
    off = point - light.centre
    half = 0.5 * float(SHADOW_SIZE)
    x = wp.dot(off, light.right) * light.scale + half
    y = wp.dot(off, light.up) * light.scale + half
    return wp.vec3(x, y, wp.dot(off, light.towards) + BIAS)


@wp.func
def turned(place: wp.vec2, turn: wp.vec2):
    """Return a place in the plane, turned by the angle of a direction."""
    return wp.vec2(place[0] * turn[0] - place[1] * turn[1], place[0] * turn[1] + place[1] * turn[0])


@wp.func
def light_arriving(light: Light, highest: wp.array(dtype=float), point: wp.vec3, turn: wp.vec2):
    """Return the share of the light that arrives at a point; ``turn``, a direction, differs between neighbours."""
    spot = under_light(light, point)
    x = spot[0]
    y = spot[1]
    own = spot[2]
    rise = float(0.0)
    count = float(0.0)
    if highest_near(light, x, y) < own:
        return 1.0
    for tap in range(TAPS):
        reach = turned(light.taps[tap], turn) * (SEARCH * light.scale)
        above = height_at(highest, x + reach[0], y + reach[1]) - own
        if above > 0.0:
            rise += above
            count += 1.0
    share = float(1.0)
    if count > 0.0:
        radius = light.spread * rise / count * light.scale
        dark = float(0.0)
        for tap in range(TAPS):
            reach = turned(light.taps[tap], turn) * radius
            if height_at(highest, x + reach[0], y + reach[1]) > own:
                dark += 1.0
        share = 1.0 - dark / float(TAPS)
    return share


@wp.func
def shaded(colour: wp.vec3, normal: wp.vec3, ray: wp.vec3, towards: wp.vec3, arriving: float, gloss: float):
    """Return linear light: hemisphere ambient, Lambert's key light, a small Blinn highlight."""
    facing = wp.max(wp.dot(normal, towards), 0.0)
    diffuse = AMBIENT * (0.72 + 0.28 * normal[2]) + KEY * arriving * facing
    half = wp.normalize(towards - ray)
    highlight = gloss * arriving * wp.pow(wp.max(wp.dot(normal, half), 0.0), 40.0)
    if facing <= 0.0:
        highlight = 0.0
    return colour * diffuse + wp.vec3(highlight, highlight, highlight)


@wp.func
def light_on_floor(scene: Scene, view: View, light: Light, highest: wp.array(dtype=float), ray: wp.vec3, turn: wp.vec2):
    """Return the share of the light that arrives at the floor along a ray; 1 where there is no floor."""
    arriving = float(1.0)
    if ray[2] < 0.0 and view.position[2] > scene.floor:
        point = view.position + ray * ((scene.floor - view.position[2]) / ray[2])
        arriving = light_arriving(light, highest, point, turn)
    return arriving


@wp.func
def floor_colour(scene: Scene, view: View, light: Light, ray: wp.vec3, arriving: float):
    """Return linear light along a ray that meets no body."""
    colour = SKY_COLOUR
    if ray[2] < 0.0 and view.position[2] > scene.floor:
        haze = wp.clamp(1.0 + ray[2] / 0.25, 0.0, 1.0)
        haze = haze * haze
        up = wp.vec3(0.0, 0.0, 1.0)
        colour = shaded(FLOOR_COLOUR, up, ray, light.towards, arriving, 0.0) * (1.0 - haze) + SKY_COLOUR * haze
    return colour


@wp.func
def body_colour(
    scene: Scene,
    view: View,
    light: Light,
    highest: wp.array(dtype=float),
    seen: wp.array(dtype=wp.vec3),
    face: int,
    x: float,
    y: float,
    ray: wp.vec3,
    turn: wp.vec2,
):
    """Return linear light from the face at a sample."""
    corners = scene.faces[face]
    a = seen[corners[0]]
    b = seen[corners[1]]
    c = seen[corners[2]]
    u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) * a[2]
    v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) * b[2]
    w = ((a[0] - x) * (b[1] - y) - (a[1] - y) * (b[0] - x)) * c[2]
    body = scene.face_body[face]
    T = scene.T[body]
    own = (u * scene.normals[face, 0] + v * scene.normals[face, 1] + w * scene.normals[face, 2]) / (u + v + w)
    normal = wp.normalize(wp.transform_vector(T, own))
    if wp.dot(normal, ray) > 0.2:
        normal = -normal
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    depth = area / (u + v + w)
    point = view.position + ray * (depth / wp.dot(ray, view.forward))
    arriving = light_arriving(light, highest, point + LIFT * normal, turn)
    return shaded(scene.colours[body], normal, ray, light.towards, arriving, GLOSS)


@wp.func
def ray_through(view: View, x: float, y: float):
    """Return the unit direction from the camera through x, y (samples) of the picture."""
    off = (x - 0.5 * float(view.width)) * view.right + (y - 0.5 * float(view.height)) * view.down
    return wp.normalize(off + view.focal * view.forward)


@wp.func
def srgb(linear: float):
    """Return a byte of sRGB."""
    return wp.uint8(wp.pow(linear, 1.0 / 2.2) * 255.0 + 0.5)


@wp.kernel
def shade_floor(
    scene: Scene,
    view: View,
    light: Light,
    picture: wp.array2d(dtype=wp.uint8),
    spots: wp.array(dtype=wp.vec3),
):
    """Write sRGB of every pixel as it is without body and shadow, and where its floor is under the light."""
    pixel = wp.tid()
    across = view.width // SUBSAMPLES
    x = (float(pixel % across) + 0.5) * float(SUBSAMPLES)
    y = (float(pixel // across) + 0.5) * float(SUBSAMPLES)
    ray = ray_through(view, x, y)
    colour = wp.min(floor_colour(scene, view, light, ray, 1.0), wp.vec3(1.0, 1.0, 1.0))
    for channel in range(3):
        picture[pixel, channel] = srgb(colour[channel])
    spot = wp.vec3(0.0, 0.0, 1.0e3)
    if ray[2] < 0.0 and view.position[2] > scene.floor:
        spot = under_light(light, view.position + ray * ((scene.floor - view.position[2]) / ray[2]))
    spots[pixel] = spot


@wp.func
def colour_at(
    scene: Scene,
    view: View,
    light: Light,
    highest: wp.array(dtype=float),
    seen: wp.array(dtype=wp.vec3),
    face: int,
    x: float,
    y: float,
    turn: wp.vec2,
):
    """Return linear light at x, y (samples) in the picture, at most 1; ``face``: seen there, if not negative."""
    ray = ray_through(view, x, y)
    colour = wp.vec3(0.0, 0.0, 0.0)
    if face < 0:
        colour = floor_colour(scene, view, light, ray, light_on_floor(scene, view, light, highest, ray, turn))
    else:
        colour = body_colour(scene, view, light, highest, seen, face, x, y, ray, turn)
    return wp.min(colour, wp.vec3(1.0, 1.0, 1.0))


@wp.kernel
def shade(
    scene: Scene,
    view: View,
    light: Light,
    highest: wp.array(dtype=float),
    seen: wp.array(dtype=wp.vec3),
    owner: wp.array(dtype=int),
    bare: wp.array2d(dtype=wp.uint8),
    spots: wp.array(dtype=wp.vec3),
    picture: wp.array2d(dtype=wp.uint8),
):
    """Write sRGB of every pixel; ``bare`` and ``spots``: what ``shade_floor`` wrote."""
    pixel = wp.tid()
    across = view.width // SUBSAMPLES
    column = pixel % across * SUBSAMPLES
    row = pixel // across * SUBSAMPLES
    first = owner[row * view.width + column]
    alike = int(1)
    for part in range(SUBSAMPLES * SUBSAMPLES):
        if owner[(row + part // SUBSAMPLES) * view.width + column + part % SUBSAMPLES] != first:
            alike = 0
    spot = spots[pixel]
    if alike == 1 and first < 0 and highest_near(light, spot[0], spot[1]) < spot[2]:
        for channel in range(3):
            picture[pixel, channel] = bare[pixel, channel]
        return
    # 7 is coprime to the 16 pixels of a tile: neighbours look at places far apart.
    number = (pixel % across % 4 + 4 * (pixel // across % 4)) * 7 % 16
    turn = wp.vec2(wp.cos(float(number) * GOLDEN_ANGLE), wp.sin(float(number) * GOLDEN_ANGLE))
    middle = 0.5 * float(SUBSAMPLES)
    mean = wp.vec3(0.0, 0.0, 0.0)
    if alike == 1:
        x = float(column) + middle
        mean = colour_at(scene, view, light, highest, seen, first, x, float(row) + middle, turn)
    else:
        for part in range(SUBSAMPLES * SUBSAMPLES):
            i = column + part % SUBSAMPLES
            j = row + part // SUBSAMPLES
            face = owner[j * view.width + i]
            mean += colour_at(scene, view, light, highest, seen, face, float(i) + 0.5, float(j) + 0.5, turn)
        mean = mean / float(SUBSAMPLES * SUBSAMPLES)
    for channel in range(3):
        picture[pixel, channel] = srgb(mean[channel])
