// The three.js scene: transducers, field planes, hands, objects, axes, camera, and what a pointer does with them.
// It draws only after something changed. Lengths are metres; z is up.

const T = window.THREE;

const SIDES = 20, DISC = 4.9e-3, HOUSING = 5.1e-3, BOARD_DEPTHS = [-1e-3, 5e-3];
const TICK = 0.05, MARGIN = 0.02, AXIS_HEIGHT = 0.25;
const FINE_FACES = 3000, JOINT = 4e-3, REACH_OF_JOINT = 8e-3, DRAG_PIXELS = 4, TURN = Math.PI / 36, ZOOM = 1.2;
const BONES = [[0, 1, 2, 3, 4], [0, 5, 6, 7, 8], [9, 10, 11, 12], [13, 14, 15, 16], [0, 17, 18, 19, 20], [5, 9, 13, 17]]
  .flatMap((chain) => chain.slice(1).map((to, k) => [chain[k], to]));
const ASIDE = [[0, -5e-3, -3e-3], [-5e-3, 0, -3e-3], [-4e-3, -4e-3, 0]];
const VIEWS = { "3D": [0.55, -0.8, 0.55], Top: [0, -1e-4, 1], Front: [0, -1, 0], Side: [1, 0, 0] };
const FIELD_OF_VIEW = 28, AWAY = 2, NEAR = 0.06, LEAST_FREE = 0.3, FITTING_STEPS = 20;
/** Pixels around the scene that labels and buttons need, and the colour bars: on its right, or below it. */
const AROUND = { left: 30, right: 30, top: 48, bottom: 18 }, BARS = { right: 254, bottom: 158 };

/** Whether a stage is so narrow that the colour bars are better below the scene. */
export const isNarrow = ({ clientWidth: width, clientHeight: height }) => width - BARS.right < height - BARS.bottom;

const vector = (flat, k = 0) => new T.Vector3(flat[3 * k], flat[3 * k + 1], flat[3 * k + 2]);
const basic = (options) => new T.MeshBasicMaterial({ side: T.DoubleSide, ...options });
const glassy = (opacity) => ({ transparent: true, opacity, depthWrite: false });

function shown(object, parent) {
  object.frustumCulled = false;
  parent.add(object);
  return object;
}

function discard(object) {
  object.removeFromParent();
  object.traverse((part) => {
    part.geometry?.dispose();
    part.material?.map?.dispose();
    part.material?.dispose();
    if (part.isInstancedMesh) part.dispose();
  });
}

/** Line segments of a width in pixels; their number may change from frame to frame. */
class Segments {
  constructor(parent, width) {
    this.material = new T.LineMaterial({ linewidth: width });
    this.line = shown(new T.LineSegments2(new T.LineSegmentsGeometry(), this.material), parent);
    this.line.onBeforeRender = (renderer) => renderer.getSize(this.material.resolution);
    this.room = 0;
  }

  show(flat) {
    const count = flat.length / 6;
    if (count > this.room) this.#grow(2 * count);
    this.line.visible = count > 0;
    if (!count) return;
    const buffer = this.line.geometry.attributes.instanceStart.data;
    buffer.array.set(flat);
    buffer.needsUpdate = true;
    this.line.geometry.instanceCount = count;
  }

  #grow(room) {
    this.line.geometry.dispose();
    this.line.geometry = new T.LineSegmentsGeometry().setPositions(new Float32Array(6 * room));
    this.room = room;
  }
}

/** Spheres of one colour; their number may change from frame to frame. */
class Spheres {
  constructor(parent) {
    this.parent = parent;
    this.material = basic();
    this.shape = new T.SphereGeometry(1, 10, 6);
    this.matrix = new T.Matrix4();
    this.room = 0;
  }

  show(count, place) {
    if (count > this.room) this.#grow(2 * count);
    if (!this.mesh) return;
    this.mesh.count = count;
    for (let k = 0; k < count; k++) {
      const [x, y, z, radius] = place(k);
      this.mesh.setMatrixAt(k, this.matrix.makeScale(radius, radius, radius).setPosition(x, y, z));
    }
    this.mesh.instanceMatrix.needsUpdate = true;
  }

  #grow(room) {
    if (this.mesh) {
      this.parent.remove(this.mesh);
      this.mesh.dispose();
    }
    this.mesh = shown(new T.InstancedMesh(this.shape, this.material, room), this.parent);
    this.room = room;
  }
}

/** The transducers of all boards, from `setup`. */
class Transducers {
  constructor(parent, setup) {
    const { positions, normals, board } = setup.arrays;
    this.cyclic = setup.arrays.cyclic;
    this.count = positions.length / 3;
    this.group = new T.Group();
    parent.add(this.group);
    this.places = Array.from({ length: this.count }, (_, k) => vector(positions, k));
    this.normals = Array.from({ length: this.count }, (_, k) => vector(normals, k).normalize());
    const up = new T.Vector3(0, 0, 1);
    this.turns = this.normals.map((normal) => new T.Quaternion().setFromUnitVectors(up, normal));
    this.discs = shown(new T.InstancedMesh(new T.CircleGeometry(1, SIDES), basic(), this.count), this.group);
    this.discs.instanceColor = new T.InstancedBufferAttribute(new Float32Array(3 * this.count), 3);
    this.housings = shown(new T.LineSegments(this.#circles(), new T.LineBasicMaterial()), this.group);
    this.crosses = new Segments(this.group, 2);
    this.ring = shown(new T.Mesh(new T.RingGeometry(1.15 * HOUSING, 1.6 * HOUSING, 32), basic()), this.group);
    this.ring.visible = false;
    this.boxes = this.#boxes(board);
    this.drawn = null;
  }

  #circles() {
    const corners = Array.from({ length: SIDES }, (_, side) => (2 * Math.PI * side) / SIDES);
    const around = corners.map((angle) => new T.Vector3(HOUSING * Math.cos(angle), HOUSING * Math.sin(angle), 0));
    const flat = this.places.flatMap((place, k) =>
      around.flatMap((offset) => offset.clone().applyQuaternion(this.turns[k]).add(place).toArray()));
    const index = this.places.flatMap((_, k) =>
      corners.flatMap((_angle, side) => [SIDES * k + side, SIDES * k + ((side + 1) % SIDES)]));
    return new T.BufferGeometry().setAttribute("position", new T.Float32BufferAttribute(flat, 3)).setIndex(index);
  }

  #boxes(board) {
    const boxes = [];
    this.places.forEach((place, k) => {
      const box = (boxes[board[k]] ??= new T.Box3());
      const normal = this.normals[k];
      const beside = normal.toArray().map((part) => HOUSING * Math.sqrt(Math.max(0, 1 - part * part)));
      for (const depth of BOARD_DEPTHS) {
        const below = place.clone().addScaledVector(normal, -depth);
        for (const sign of [-1, 1]) box.expandByPoint(below.clone().addScaledVector(new T.Vector3(...beside), sign));
      }
    });
    return boxes.map((box) => ({ box, outline: shown(new T.Box3Helper(box), this.group) }));
  }

  show(phase, amplitude) {
    const colours = this.discs.instanceColor;
    for (let k = 0; k < this.count; k++) {
      const from = 3 * phase[k];
      for (let c = 0; c < 3; c++) colours.array[3 * k + c] = this.cyclic[from + c] / 255;
    }
    colours.needsUpdate = true;
    for (let k = 0; k < this.count; k++) {
      if (this.drawn?.[k] !== amplitude[k]) this.#size(k, (DISC * amplitude[k]) / 255);
    }
    this.drawn = amplitude;
  }

  #size(k, radius) {
    this.discs.setMatrixAt(k, new T.Matrix4().compose(this.places[k], this.turns[k], new T.Vector3(radius, radius, radius)));
    this.discs.instanceMatrix.needsUpdate = true;
  }

  mark(pick, silenced) {
    this.ring.visible = pick in this.places;
    if (this.ring.visible) {
      this.ring.position.copy(this.places[pick]).addScaledVector(this.normals[pick], 4e-4);
      this.ring.quaternion.copy(this.turns[pick]);
    }
    this.crosses.show(silenced.filter((k) => k in this.places).flatMap((k) => this.#cross(k)));
  }

  #cross(k) {
    const arm = 0.75 * HOUSING;
    return [[-1, -1], [1, 1], [-1, 1], [1, -1]].flatMap(([x, y]) =>
      new T.Vector3(arm * x, arm * y, 4e-4).applyQuaternion(this.turns[k]).add(this.places[k]).toArray());
  }

  hit(ray) {
    const hits = this.places.map((place, k) => {
      const along = place.clone().sub(ray.origin).dot(this.normals[k]) / ray.direction.dot(this.normals[k]);
      return { transducer: k, along, off: ray.at(along, new T.Vector3()).distanceTo(place) };
    });
    return hits.filter(({ along, off }) => along > 0 && off < HOUSING).sort((a, b) => a.along - b.along)[0];
  }
}

/** One field plane: a picture whose samples (0, 0) and (last, last) lie at `corner` and `corner + u + v`. */
class Plane {
  constructor(parent, colour) {
    const geometry = new T.BufferGeometry();
    geometry.setAttribute("position", new T.BufferAttribute(new Float32Array(12), 3));
    geometry.setAttribute("uv", new T.BufferAttribute(new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]), 2));
    geometry.setIndex([0, 1, 3, 0, 3, 2]);
    // What lies in the plane, such as a palm, is seen: the plane is a little behind it.
    const behind = { polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 8 };
    this.mesh = shown(new T.Mesh(geometry, basic(behind)), parent);
    const border = new T.BufferGeometry().setAttribute("position", geometry.attributes.position).setIndex([0, 1, 3, 2]);
    this.border = shown(new T.LineLoop(border, new T.LineBasicMaterial({ color: colour })), this.mesh);
  }

  show({ corner, u, v }, values, map) {
    const [rows, columns] = values.shape;
    this.corner = vector(corner);
    this.u = vector(u);
    this.v = vector(v);
    const halfU = this.u.clone().multiplyScalar(0.5 / Math.max(1, columns - 1));
    const halfV = this.v.clone().multiplyScalar(0.5 / Math.max(1, rows - 1));
    const at = this.mesh.geometry.attributes.position;
    [[0, 0], [1, 0], [0, 1], [1, 1]].forEach(([right, up], k) => {
      const place = this.corner.clone().addScaledVector(this.u, right).addScaledVector(this.v, up);
      place.addScaledVector(halfU, 2 * right - 1).addScaledVector(halfV, 2 * up - 1).toArray(at.array, 3 * k);
    });
    at.needsUpdate = true;
    this.#paint(rows, columns, values, map);
  }

  #paint(rows, columns, values, map) {
    let image = this.texture?.image;
    if (image?.width !== columns || image?.height !== rows) {
      this.texture?.dispose();
      this.texture = new T.DataTexture(new Uint8Array(4 * rows * columns), columns, rows);
      this.mesh.material.map = this.texture;
      this.mesh.material.needsUpdate = true;
      image = this.texture.image;
    }
    paint(image.data, values, map);
    this.texture.needsUpdate = true;
  }

  hit(ray) {
    const normal = this.u.clone().cross(this.v).normalize();
    const along = this.corner.clone().sub(ray.origin).dot(normal) / ray.direction.dot(normal);
    const at = ray.at(along, new T.Vector3());
    const inside = [this.u, this.v].every((side) => {
      const part = at.clone().sub(this.corner).dot(side) / side.lengthSq();
      return part >= 0 && part <= 1;
    });
    return along > 0 && inside ? { along, at } : undefined;
  }
}

/** Write the colours of values 0 to 255 as RGBA. */
export function paint(rgba, values, map) {
  for (let k = 0; k < values.length; k++) {
    const from = 3 * values[k];
    rgba[4 * k] = map[from];
    rgba[4 * k + 1] = map[from + 1];
    rgba[4 * k + 2] = map[from + 2];
    rgba[4 * k + 3] = 255;
  }
}

/** All hands: palms and fingers as quads, bones, joints. */
class Hands {
  constructor(parent) {
    this.skin = shown(new T.Mesh(new T.BufferGeometry(), basic(glassy(0.3))), parent);
    this.bones = new Segments(parent, 2.5);
    this.joints = new Spheres(parent);
  }

  show(landmarks, quads) {
    this.landmarks = landmarks;
    const hands = landmarks.length / 63;
    const joint = (k) => [landmarks[3 * k], landmarks[3 * k + 1], landmarks[3 * k + 2], JOINT];
    this.joints.show(21 * hands, joint);
    this.bones.show(Array.from({ length: hands }, (_, hand) =>
      BONES.flat().flatMap((k) => joint(21 * hand + k).slice(0, 3))).flat());
    this.skin.visible = quads.length > 0;
    if (this.skin.visible) this.#cover(quads);
  }

  #cover(quads) {
    let at = this.skin.geometry.attributes.position;
    if (at?.array.length !== quads.length) {
      this.skin.geometry.dispose();
      this.skin.geometry = new T.BufferGeometry();
      at = new T.BufferAttribute(new Float32Array(quads.length), 3);
      this.skin.geometry.setAttribute("position", at);
      this.skin.geometry.setIndex(Array.from({ length: quads.length / 12 }, (_, k) =>
        [0, 1, 2, 0, 2, 3].map((corner) => 4 * k + corner)).flat());
    }
    at.array.set(quads);
    at.needsUpdate = true;
    this.skin.geometry.boundingSphere = null;
  }

  hit(ray, caster) {
    const joints = Array.from({ length: (this.landmarks?.length ?? 0) / 3 }, (_, k) => vector(this.landmarks, k))
      .filter((place) => ray.distanceToPoint(place) < REACH_OF_JOINT);
    const found = this.skin.visible ? caster.intersectObject(this.skin).map((hit) => hit.point) : [];
    return nearest(ray, [...joints, ...found]);
  }
}

function nearest(ray, places) {
  return places.map((at) => ({ at, along: at.distanceTo(ray.origin) })).sort((a, b) => a.along - b.along)[0];
}

/** One object's surface: translucent, with the edges between faces of different directions. */
class Solid {
  constructor(parent, vertices, faces) {
    const at = new T.BufferAttribute(new Float32Array(vertices), 3);
    const corners = new T.BufferAttribute(new Uint32Array(faces), 1);
    const surface = new T.BufferGeometry().setAttribute("position", at).setIndex(corners);
    const outline = new T.BufferGeometry().setAttribute("position", at).setIndex(edges(vertices, faces));
    this.mesh = shown(new T.Mesh(surface, basic(glassy(0.22))), parent);
    this.outline = shown(new T.LineSegments(outline, new T.LineBasicMaterial({ transparent: true })), parent);
    this.at = at;
    this.faces = faces;
    this.clarity = Math.min(0.5, 3000 / outline.index.count);
  }

  has(faces) {
    return faces.length === this.faces.length && faces.every((corner, k) => corner === this.faces[k]);
  }

  move(vertices) {
    this.at.array.set(vertices);
    this.at.needsUpdate = true;
    this.mesh.geometry.boundingSphere = null;
  }

  colour(colour, selected) {
    this.mesh.material.color.set(colour);
    this.outline.material.color.set(colour);
    this.outline.material.opacity = selected ? this.clarity : 0.6 * this.clarity;
    this.mesh.material.opacity = selected ? 0.28 : 0.18;
  }

  dispose() {
    discard(this.mesh);
    discard(this.outline);
  }
}

/** Pairs of vertices: the edges between faces that are not parallel, and of one face only; of a fine mesh the sharp ones. */
function edges(vertices, faces) {
  const found = new Map();
  const parallel = faces.length > 3 * FINE_FACES ? Math.cos(0.25) : Math.cos(0.02);
  for (let k = 0; k < faces.length; k += 3) {
    const corners = [0, 1, 2].map((c) => faces[k + c]);
    const [a, b, c] = corners.map((corner) => vector(vertices, corner));
    const normal = b.sub(a).cross(c.sub(a)).normalize();
    corners.forEach((from, side) => {
      const pair = [from, corners[(side + 1) % 3]].sort((p, q) => p - q);
      const key = pair[0] * vertices.length + pair[1];
      const other = found.get(key);
      if (other && Math.abs(other.normal.dot(normal)) > parallel) found.delete(key);
      else if (!other) found.set(key, { pair, normal });
    });
  }
  return [...found.values()].flatMap(({ pair }) => pair);
}

/** The three axes with a tick every 50 mm, along the edges of the space that is shown. */
class Axes {
  constructor(parent, bounds) {
    const low = bounds.min.clone().sub(new T.Vector3(MARGIN, MARGIN, 0));
    low.z = bounds.min.z;
    const labels = [], flat = [];
    this.lines = [0, 1, 2].map((axis) => {
      const from = low.clone().setComponent(axis, Math.ceil(bounds.min.getComponent(axis) / TICK - 1e-6) * TICK);
      const to = low.clone().setComponent(axis, Math.floor(bounds.max.getComponent(axis) / TICK + 1e-6) * TICK);
      const aside = new T.Vector3(...ASIDE[axis]);
      flat.push(...from.toArray(), ...to.toArray());
      for (let value = from.getComponent(axis); value < to.getComponent(axis) + 1e-6; value += TICK) {
        const at = from.clone().setComponent(axis, value);
        flat.push(...at.toArray(), ...at.clone().add(aside).toArray());
        labels.push({ axis, at: at.addScaledVector(aside, 2.2), text: `${Math.round(1000 * value)}`, kind: "tick" });
      }
      const middle = from.clone().lerp(to, 0.5).addScaledVector(aside, 5.5);
      labels.unshift({ axis, at: middle, text: `${"xyz"[axis]} / mm`, kind: "name" });
      return { from, to };
    });
    this.labels = labels;
    const geometry = new T.BufferGeometry().setAttribute("position", new T.BufferAttribute(new Float32Array(flat), 3));
    this.mesh = shown(new T.LineSegments(geometry, new T.LineBasicMaterial()), parent);
  }
}

/** Whether WebGL is drawn by the processor: then smooth edges would cost half of the pictures a second. */
export function isDrawnBySoftware() {
  const gl = document.createElement("canvas").getContext("webgl");
  const named = gl?.getExtension("WEBGL_debug_renderer_info");
  const renderer = named ? gl.getParameter(named.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(renderer);
}

export class Scene {
  /**
   * `overlay` is an element for labels. `events` has before() and drawn(), called around each picture,
   * probe([x, y, z]), pick(transducer), select(object), moved(what, [x, y, z]), and movable(what), which gives the
   * place of "hand" or of an object's number, or null if it cannot be moved.
   */
  constructor(canvas, overlay, events, antialias) {
    this.canvas = canvas;
    this.overlay = overlay;
    this.events = events;
    this.renderer = new T.WebGLRenderer({ canvas, antialias });
    this.scene = new T.Scene();
    this.lenses = { space: new T.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 20), flat: new T.OrthographicCamera(-1, 1, 1, -1, 0.01, 20) };
    Object.values(this.lenses).forEach((camera) => camera.up.set(0, 0, 1));
    this.camera = this.lenses.space;
    this.metresPerPixel = 1e-3;
    this.hands = new Hands(this.scene);
    this.arcs = new Segments(this.scene, 3);
    this.points = new Spheres(this.scene);
    this.probe = shown(new T.Mesh(new T.OctahedronGeometry(4e-3), basic({ wireframe: true })), this.scene);
    this.probe.visible = false;
    this.planes = new Map();
    this.solids = [];
    this.selected = 0;
    this.faults = [];
    this.view = VIEWS["3D"];
    this.fitted = true;
    this.#listen();
    this.setBounds(new T.Box3(new T.Vector3(-0.1, -0.1, 0), new T.Vector3(0.1, 0.1, AXIS_HEIGHT)));
  }

  // What is shown

  setUp(setup) {
    if (this.transducers) discard(this.transducers.group);
    this.transducers = new Transducers(this.scene, setup);
    this.maps = setup.arrays;
    const bounds = new T.Box3().setFromPoints(this.transducers.places).expandByScalar(HOUSING);
    bounds.min.z += HOUSING;
    bounds.max.z = Math.max(bounds.max.z, bounds.min.z + AXIS_HEIGHT);
    this.setBounds(bounds);
    this.setColours(this.colours);
  }

  setBounds(bounds) {
    if (this.axes) discard(this.axes.mesh);
    this.bounds = bounds;
    this.axes = new Axes(this.scene, bounds);
    if (this.fitted) this.look(this.view);
  }

  setObjects({ count, arrays }) {
    const old = this.solids;
    this.solids = Array.from({ length: count }, (_, k) => {
      const vertices = arrays[`vertices${k}`], faces = arrays[`faces${k}`];
      if (!old[k]?.has(faces)) return new Solid(this.scene, vertices, faces);
      old[k].move(vertices);
      return old[k];
    });
    old.filter((solid) => !this.solids.includes(solid)).forEach((solid) => solid.dispose());
    this.setColours(this.colours);
  }

  select(object) {
    this.selected = object;
    this.setColours(this.colours);
  }

  setColours(colours) {
    this.colours = colours;
    if (!colours) return;
    this.scene.background = new T.Color(colours.scene);
    const paints = [[this.axes.mesh, "axis"], [this.hands.skin, "hand"], [this.hands.bones, "hand"], [this.hands.joints, "hand"],
      [this.arcs, "arc"], [this.points, "point"], [this.probe, "probe"]];
    if (this.transducers) {
      paints.push([this.transducers.housings, "housing"], [this.transducers.ring, "accent"], [this.transducers.crosses, "bad"]);
    }
    paints.forEach(([part, name]) => part.material.color.set(colours[name]));
    this.planes.forEach(({ border }) => border.material.color.set(colours.axis));
    this.solids.forEach((solid, k) => solid.colour(colours[k === this.selected ? "accent" : "object"], k === this.selected));
    this.#paintBoards();
    this.redraw();
  }

  #paintBoards() {
    this.transducers?.boxes.forEach(({ outline }, board) =>
      outline.material.color.set(this.colours[this.faults[board] ? "bad" : "housing"]));
    this.labelsChanged = true;
  }

  mark(settings) {
    this.transducers?.mark(settings.pick ?? -1, settings.silenced ?? []);
    this.redraw();
  }

  show(frame) {
    const { arrays } = frame;
    this.transducers?.show(arrays.phase, arrays.amplitude);
    this.hands.show(arrays.landmarks ?? [], arrays.quads ?? []);
    if (this.fitted && !this.sawHands && arrays.landmarks?.length) this.look(this.view);
    this.sawHands ||= arrays.landmarks?.length > 0;
    this.arcs.show(arrays.arcs ?? []);
    this.#showPoints(arrays.points ?? []);
    this.#showPlanes(frame);
    this.solids.forEach((solid, k) => arrays[`mesh${k}`] && solid.move(arrays[`mesh${k}`]));
    this.probe.visible = Boolean(frame.probe);
    if (frame.probe) this.probe.position.set(...frame.probe.at);
    if (frame.boards.join("\n") !== this.faults.join("\n")) {
      this.faults = frame.boards;
      this.#paintBoards();
    }
    this.redraw();
  }

  #showPoints(points) {
    this.points.show(points.length / 4, (k) =>
      [...points.subarray(4 * k, 4 * k + 3), 0.8e-3 + 1.4e-3 * Math.min(1, points[4 * k + 3])]);
  }

  #showPlanes({ planes, scale, arrays }) {
    const map = scale.cyclic ? this.maps.cyclic : this.maps.sequential;
    for (const plane of this.planes.values()) plane.mesh.visible = false;
    for (const plane of planes) {
      if (!this.planes.has(plane.name)) this.planes.set(plane.name, new Plane(this.scene, this.colours.axis));
      const shownPlane = this.planes.get(plane.name);
      shownPlane.show(plane, arrays[plane.name], map);
      shownPlane.mesh.visible = true;
    }
  }

  // Camera

  /** Look from a direction: what is shown fills the free part of the canvas, in its middle. Along an axis it is seen without perspective. */
  look(direction) {
    this.view = direction;
    this.camera = direction === VIEWS["3D"] ? this.lenses.space : this.lenses.flat;
    this.orbit.object = this.camera;
    this.camera.zoom = 1;
    const away = new T.Vector3(...direction).normalize();
    const { target, distance } = this.#fit(away);
    this.orbit.target.copy(target);
    this.camera.position.copy(target).addScaledVector(away, distance);
    this.#setLens();
    this.orbit.update();
    this.fitted = true;
    this.labelsChanged = true;
    this.redraw();
  }

  /** The part of the canvas for the scene, in pixels. */
  #free() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const low = isNarrow(this.canvas);
    const right = low ? AROUND.right : BARS.right, bottom = low ? BARS.bottom : AROUND.bottom;
    const wide = Math.max(LEAST_FREE * width, width - AROUND.left - right, 1);
    const high = Math.max(LEAST_FREE * height, height - AROUND.top - bottom, 1);
    return { wide, high, x: AROUND.left + 0.5 * wide, y: AROUND.top + 0.5 * high };
  }

  /** Where to look at, and from how far, so that all fits; without perspective the scale is set instead. */
  #fit(away) {
    const right = this.camera.up.clone().cross(away).normalize(), up = away.clone().cross(right);
    const { wide, high } = this.#free(), flat = this.camera === this.lenses.flat;
    const pixel = (2 * Math.tan((0.5 * FIELD_OF_VIEW * Math.PI) / 180)) / Math.max(1, this.canvas.clientHeight);
    const target = this.bounds.getCenter(new T.Vector3()), places = this.#extent();
    let distance = AWAY;
    for (let step = 0; step < FITTING_STEPS; step++) {
      const seen = places.map((place) => {
        const offset = place.clone().sub(target);
        const depth = flat ? 1 : Math.max(distance - offset.dot(away), 0.05);
        return new T.Vector2(offset.dot(right) / depth, offset.dot(up) / depth);
      });
      const box = new T.Box2().setFromPoints(seen), middle = box.getCenter(new T.Vector2()), size = box.getSize(new T.Vector2());
      const scale = Math.max(size.x / wide, size.y / high), depth = flat ? 1 : distance;
      target.addScaledVector(right, middle.x * depth).addScaledVector(up, middle.y * depth);
      if (flat) this.metresPerPixel = scale;
      else distance *= scale / pixel;
    }
    return { target, distance };
  }

  /** What must be seen: the corners of the space with its planes, the labels, and hands as far as they are near. */
  #extent() {
    const space = this.bounds.clone().expandByVector(new T.Vector3(MARGIN, MARGIN, 0));
    const { min, max } = space, near = space.clone().expandByVector(new T.Vector3(NEAR, NEAR, 0));
    const corners = [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z) => new T.Vector3(x, y, z))));
    const hands = Array.from({ length: (this.hands.landmarks?.length ?? 0) / 3 }, (_, k) =>
      vector(this.hands.landmarks, k).clamp(near.min, near.max));
    return [...corners, ...this.axes.labels.map(({ at }) => at), ...hands];
  }

  #setLens() {
    const { clientWidth: width, clientHeight: height } = this.canvas, { x, y } = this.#free();
    const [right, top] = [width, height].map((pixels) => 0.5 * pixels * this.metresPerPixel);
    Object.assign(this.lenses.flat, { left: -right, right, top, bottom: -top });
    this.camera.setViewOffset(width, height, 0.5 * width - x, 0.5 * height - y, width, height);
  }

  lookFrom(name) {
    this.look(VIEWS[name]);
  }

  zoom(closer) {
    if (this.camera === this.lenses.flat) {
      this.camera.zoom *= closer ? ZOOM : 1 / ZOOM;
      this.camera.updateProjectionMatrix();
      this.orbit.dispatchEvent({ type: "change" });
    } else this.#swing((place) => { place.radius *= closer ? 1 / ZOOM : ZOOM; });
  }

  #turn(right, up) {
    this.#swing((place) => {
      place.theta += TURN * right;
      place.phi -= TURN * up;
    });
  }

  #swing(change) {
    const zUp = new T.Quaternion().setFromUnitVectors(this.camera.up, new T.Vector3(0, 1, 0));
    const place = new T.Spherical().setFromVector3(this.camera.position.clone().sub(this.orbit.target).applyQuaternion(zUp));
    change(place);
    place.makeSafe();
    this.camera.position.setFromSpherical(place).applyQuaternion(zUp.invert()).add(this.orbit.target);
    this.orbit.update();
  }

  /** Where a point is on the canvas, in CSS pixels. */
  onCanvas(point) {
    const ndc = point.clone().project(this.camera);
    return [(0.5 + 0.5 * ndc.x) * this.canvas.clientWidth, (0.5 - 0.5 * ndc.y) * this.canvas.clientHeight];
  }

  project(place) {
    const [x, y] = this.onCanvas(new T.Vector3(...place));
    const { left, top } = this.canvas.getBoundingClientRect();
    return [left + x, top + y];
  }

  // Drawing

  redraw() {
    this.waiting ??= requestAnimationFrame(() => {
      this.events.before();
      this.waiting = undefined;
      this.draw();
    });
  }

  draw() {
    this.renderer.render(this.scene, this.camera);
    if (this.labelsChanged) this.#placeLabels();
    this.events.drawn();
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    this.renderer.setSize(width, height);
    if (this.fitted) this.look(this.view);
    else this.#setLens();
    this.labelsChanged = true;
    this.redraw();
  }

  #placeLabels() {
    this.labelsChanged = false;
    const taken = [];
    this.labels = [...this.#boardLabels(), ...this.#axisLabels()].map((label) => {
      const [x, y] = this.onCanvas(label.at).map(Math.round);
      return { ...label, x, y, half: 3.5 * label.text.length + 2 };
    }).filter((label) => {
      const free = !taken.some(({ x, y, half }) => Math.abs(x - label.x) < half + label.half && Math.abs(y - label.y) < 13);
      if (free) taken.push(label);
      return free;
    });
    this.#showLabels();
  }

  #showLabels() {
    while (this.overlay.children.length > this.labels.length) this.overlay.lastChild.remove();
    this.labels.forEach(({ x, y, text, kind }, k) => {
      const shownLabel = this.overlay.children[k] ?? this.overlay.appendChild(document.createElement("span"));
      shownLabel.textContent = text;
      shownLabel.className = kind;
      shownLabel.style.transform = `translate(${x}px, ${y}px) translate(-50%, -50%)`;
    });
  }

  #boardLabels() {
    const boxes = this.transducers?.boxes ?? [];
    return boxes.map(({ box }, board) => {
      const at = new T.Vector3(0.5 * (box.min.x + box.max.x), box.max.y + 0.014, box.max.z + 0.008);
      const fault = this.faults[board];
      return { at, text: fault ? `board ${board}: ${fault}` : `board ${board}`, kind: fault ? "bad" : "tick" };
    }).sort((a, b) => a.kind.localeCompare(b.kind));
  }

  #axisLabels() {
    const long = this.axes.lines.map(({ from, to }) => {
      const [[x0, y0], [x1, y1]] = [this.onCanvas(from), this.onCanvas(to)];
      return Math.hypot(x1 - x0, y1 - y0) > 60;
    });
    return this.axes.labels.filter(({ axis }) => long[axis]);
  }

  // Pointer and keys

  #listen() {
    this.canvas.parentElement.addEventListener("pointerdown", (event) => this.#press(event), true);
    this.canvas.addEventListener("pointermove", (event) => this.#drag(event));
    for (const end of ["pointerup", "pointercancel"]) this.canvas.addEventListener(end, (event) => this.#release(event));
    this.canvas.addEventListener("keydown", (event) => this.#key(event));
    this.canvas.addEventListener("webglcontextrestored", () => this.redraw());
    this.orbit = new T.OrbitControls(this.camera, this.canvas);
    this.orbit.minDistance = 0.05;
    this.orbit.maxDistance = 5;
    this.orbit.addEventListener("change", () => {
      this.fitted = false;
      this.labelsChanged = true;
      this.redraw();
    });
    new ResizeObserver(() => this.#resize()).observe(this.canvas.parentElement);
  }

  #key(event) {
    const moves = {
      ArrowLeft: () => this.#turn(-1, 0), ArrowRight: () => this.#turn(1, 0), ArrowUp: () => this.#turn(0, 1),
      ArrowDown: () => this.#turn(0, -1), "+": () => this.zoom(true), "=": () => this.zoom(true), "-": () => this.zoom(false),
    };
    if (!moves[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    moves[event.key]();
  }

  #caster(event) {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const caster = new T.Raycaster();
    const at = new T.Vector2(2 * (event.clientX - left) / width - 1, 1 - 2 * (event.clientY - top) / height);
    caster.setFromCamera(at, this.camera);
    return caster;
  }

  #press(event) {
    if (event.target !== this.canvas || event.button !== 0 || this.grabbed) return;
    this.canvas.focus({ preventScroll: true });
    this.pressed = { x: event.clientX, y: event.clientY };
    const caster = this.#caster(event);
    const grabbed = this.#graspable(caster);
    if (!grabbed) return;
    this.orbit.enabled = false;
    this.canvas.setPointerCapture(event.pointerId);
    const facing = this.camera.getWorldDirection(new T.Vector3());
    this.grabbed = { ...grabbed, plane: new T.Plane().setFromNormalAndCoplanarPoint(facing, grabbed.at) };
    if (grabbed.what !== "hand") this.events.select(grabbed.what);
  }

  #graspable(caster) {
    const near = (this.#planeHit(caster.ray)?.along ?? Infinity) + REACH_OF_JOINT;
    const solids = this.solids.map(({ mesh }, what) =>
      ({ what, hit: nearest(caster.ray, caster.intersectObject(mesh).map(({ point }) => point)) }));
    solids.sort((a, b) => (a.hit?.along ?? Infinity) - (b.hit?.along ?? Infinity));
    const candidates = [{ what: "hand", hit: this.hands.hit(caster.ray, caster) }, ...solids];
    const found = candidates.find(({ what, hit }) => hit && hit.along < near && this.events.movable(what));
    return found && { what: found.what, at: found.hit.at, from: this.events.movable(found.what) };
  }

  #planeHit(ray) {
    return [...this.planes.values()].filter(({ mesh }) => mesh.visible).map((plane) => plane.hit(ray)).filter(Boolean)
      .sort((a, b) => a.along - b.along)[0];
  }

  #drag(event) {
    if (!this.grabbed || this.#still(event)) return;
    const { what, at, from, plane } = this.grabbed;
    const now = this.#caster(event).ray.intersectPlane(plane, new T.Vector3());
    if (now) this.events.moved(what, now.sub(at).toArray().map((step, k) => from[k] + step));
  }

  #still(event) {
    if (this.pressed && Math.hypot(event.clientX - this.pressed.x, event.clientY - this.pressed.y) < DRAG_PIXELS) return true;
    this.pressed = undefined;
    return false;
  }

  #release(event) {
    if (event.type === "pointerup" && this.pressed && this.#still(event)) this.#click(this.#caster(event).ray);
    this.pressed = this.grabbed = undefined;
    this.orbit.enabled = true;
  }

  #click(ray) {
    const plane = this.#planeHit(ray), disc = this.transducers?.hit(ray);
    if (plane && !(disc?.along < plane.along)) this.events.probe(plane.at.toArray());
    else if (disc) this.events.pick(disc.transducer);
  }
}
