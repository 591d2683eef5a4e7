"use strict";

// Blocks in WebGL 1: the scene is moved on the processor, frame by frame, and drawn as flat triangles and edges.

const CIVIDIS = [[0, 34, 78], [44, 65, 114], [87, 93, 109], [125, 124, 120], [165, 156, 116], [210, 192, 96], [254, 232, 56]];
const STONE = [0.78, 0.78, 0.76], ACTUATOR = [0.84, 0.37, 0], DEAD = [0.36, 0.25, 0.63], CENTRE = [0, 0.45, 0.7], TIE = [0.85, 0, 0.54];
const VIEWS = {iso: [1, -1.5, 1.4], front: [0, -1, 0], back: [0, 1, 0], side: [1, 0, 0], top: [0, 0, 1]};
const NEAR_POLE = 1.5533; // rad: the view never tips over

const VERTEX = `
attribute vec3 place; attribute vec3 normal; attribute vec3 colour;
uniform mat4 camera; uniform vec3 eye;
varying vec3 shade;
void main() {
  gl_Position = camera * vec4(place, 1.0);
  float lit = 1.0;
  if (dot(normal, normal) > 0.0) {
    vec3 n = normalize(normal);
    lit = 0.6 + 0.26 * abs(dot(n, normalize(eye - place))) + 0.14 * n.z;
  }
  shade = colour * lit;
}`;
const FRAGMENT = `
precision mediump float;
varying vec3 shade;
void main() { gl_FragColor = vec4(shade, 1.0); }`;

function cividis(share) {
  const at = Math.min(Math.max(share, 0), 1) * (CIVIDIS.length - 1), i = Math.min(Math.floor(at), CIVIDIS.length - 2);
  return CIVIDIS[i].map((low, k) => (low + (at - i) * (CIVIDIS[i + 1][k] - low)) / 255);
}

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const plus = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
function unit(a) { const size = Math.hypot(...a); return size > 0 ? a.map((x) => x / size) : [0, 0, 1]; }

// The matrix R - I of a rotation vector, which keeps the digits of tiny turns; the angle is at most half a turn.
function turn(wx, wy, wz, out) {
  const angle = Math.hypot(wx, wy, wz);
  if (angle === 0) return out.fill(0);
  const shown = Math.min(angle, Math.PI), x = wx / angle, y = wy / angle, z = wz / angle;
  const s = Math.sin(shown), c = 2 * Math.sin(shown / 2) ** 2;
  out[0] = -c * (y * y + z * z); out[1] = c * x * y - s * z; out[2] = c * x * z + s * y;
  out[3] = c * x * y + s * z; out[4] = -c * (x * x + z * z); out[5] = c * y * z - s * x;
  out[6] = c * x * z - s * y; out[7] = c * y * z + s * x; out[8] = -c * (x * x + y * y);
  return out;
}

// The quaternion of the rotation vector that begins at a place in an array.
function quaternion(vectors, at) {
  const x = vectors[at], y = vectors[at + 1], z = vectors[at + 2], angle = Math.hypot(x, y, z);
  const scale = angle > 0 ? Math.sin(angle / 2) / angle : 0.5;
  return [Math.cos(angle / 2), scale * x, scale * y, scale * z];
}

// The rotation vector a share of the way from one to another one of an array, into out[3] to out[5]. Vectors jump to
// the other side past half a turn, so it goes by the shorter way between the two rotations. Tiny turns keep their digits.
function turnBetween(vectors, one, two, share, out) {
  const [a, ...u] = quaternion(vectors, one), [b, ...v] = quaternion(vectors, two);
  const across = cross(v, u), cosine = a * b + dot(u, v), way = cosine < 0 ? -1 : 1;
  const step = [0, 1, 2].map((i) => way * (a * v[i] - b * u[i] + across[i])), size = Math.hypot(...step);
  const part = share * Math.atan2(size, Math.abs(cosine)), scale = size > 0 ? Math.sin(part) / size : 0, c = Math.cos(part);
  const beside = cross(u, step), whole = a * c - scale * dot(u, step);
  const found = [0, 1, 2].map((i) => c * u[i] + scale * (a * step[i] + beside[i])), half = Math.hypot(...found);
  const long = half > 0 ? (2 * Math.atan2(half, Math.abs(whole)) / half) * (whole < 0 ? -1 : 1) : 0;
  for (let i = 0; i < 3; i++) out[3 + i] = long * found[i];
}

// Displacement and rotation vector of block b between two frames, at the fractional frame number f.
function motionAt(scene, f, b, out) {
  const k = Math.min(Math.floor(f), scene.frames - 1), next = Math.min(k + 1, scene.frames - 1), share = f - k;
  for (let i = 0; i < 3; i++) {
    const one = 3 * (k * scene.blocks + b) + i, two = 3 * (next * scene.blocks + b) + i;
    out[i] = scene.displacement[one] + share * (scene.displacement[two] - scene.displacement[one]);
  }
  turnBetween(scene.rotation, 3 * (k * scene.blocks + b), 3 * (next * scene.blocks + b), share, out);
  return out;
}

// Triangles and edges out of the faces: flat normals, so every face has vertices of its own.
function surfaces(scene) {
  const corner = (v) => [scene.vertices[3 * v], scene.vertices[3 * v + 1], scene.vertices[3 * v + 2]];
  const triangles = {vertex: [], normal: []}, edges = [];
  for (let at = 0; at < scene.faces.length;) {
    const count = scene.faces[at], face = scene.faces.subarray(at + 1, at + 1 + count);
    at += 1 + count;
    let normal = [0, 0, 0];
    for (let i = 1; i + 1 < count; i++)
      normal = plus(normal, cross(minus(corner(face[i]), corner(face[0])), minus(corner(face[i + 1]), corner(face[0]))));
    normal = unit(normal);
    for (let i = 1; i + 1 < count; i++) {
      triangles.vertex.push(face[0], face[i], face[i + 1]);
      triangles.normal.push(...normal, ...normal, ...normal);
    }
    for (let i = 0; i < count; i++) if (face[i] < face[(i + 1) % count]) edges.push(face[i], face[(i + 1) % count]);
  }
  return {vertex: Uint32Array.from(triangles.vertex), normal: Float32Array.from(triangles.normal), edges: Uint32Array.from(edges)};
}

function perspective(eye, up, reach, wide) {
  const back = unit(eye), right = unit(cross(up, back)), above = cross(back, right), distance = Math.hypot(...eye);
  const focal = 1 / Math.tan(0.24), near = Math.max(distance - 3 * reach, 0.01 * distance), far = distance + 3 * reach;
  const rows = [[...right, -dot(right, eye)], [...above, -dot(above, eye)], [...back, -dot(back, eye)]];
  const fit = wide < 1 ? wide : 1; // a narrow window shows the whole scene too
  const a = -(far + near) / (far - near), b = -2 * far * near / (far - near), matrix = new Float32Array(16);
  for (let j = 0; j < 4; j++) {
    matrix[4 * j] = fit * focal / wide * rows[0][j];
    matrix[4 * j + 1] = fit * focal * rows[1][j];
    matrix[4 * j + 2] = a * rows[2][j] + (j === 3 ? b : 0);
    matrix[4 * j + 3] = -rows[2][j];
  }
  return matrix;
}

// An arrow or a rod as a prism about an axis, with a pyramid at its tip if `head` is its length.
function rod(from, along, length, radius, head, colour, out) {
  const one = unit(Math.abs(along[2]) < 0.9 ? cross(along, [0, 0, 1]) : cross(along, [1, 0, 0])), two = cross(along, one);
  const ring = (at, r) => [0, 1, 2, 3, 4, 5].map((i) =>
    plus(plus(plus(from, along, at), one, r * Math.cos(i * Math.PI / 3)), two, r * Math.sin(i * Math.PI / 3)));
  const face = (...points) => {
    const normal = unit(cross(minus(points[1], points[0]), minus(points[2], points[0])));
    for (let i = 1; i + 1 < points.length; i++)
      for (const point of [points[0], points[i], points[i + 1]]) out.push(...point, ...normal, ...colour);
  };
  const shaft = Math.max(length - head, 0), low = ring(0, radius), high = ring(shaft, radius), brim = ring(shaft, 2.6 * radius);
  const tip = plus(from, along, length);
  for (let i = 0; i < 6; i++) {
    const j = (i + 1) % 6;
    face(low[i], low[j], high[j], high[i]);
    if (head) { face(brim[i], brim[j], tip); face(brim[j], brim[i], plus(from, along, shaft)); }
  }
}

// Returns {show(frame, magnification), paint(quantity), look(name)}; throws an Error in plain words where there is no WebGL.
function makeViewer(canvas, scene) {
  const gl = canvas.getContext("webgl", {antialias: true, alpha: true});
  if (!gl) throw new Error("This browser shows no WebGL, so the blocks cannot be drawn; the diagrams below work without.");
  const parts = surfaces(scene), count = parts.vertex.length;
  const points = new Float32Array(9 * count), lines = new Float32Array(9 * parts.edges.length);
  const moved = new Float32Array(scene.vertices.length), amount = new Float32Array(scene.vertices.length / 3);
  const rest = new Float32Array(9 * parts.edges.length), motion = new Float64Array(6);
  const shownTurn = new Float64Array(9), trueTurn = new Float64Array(9), turns = new Float64Array(9 * scene.blocks);
  const [, , above] = unit(VIEWS.iso);
  let program, buffer, places, angle = Math.atan2(VIEWS.iso[1], VIEWS.iso[0]), height = Math.asin(above), near = 1;
  let frame = 0, magnification = 1, waiting = false, paint = null;

  function prepare() {
    program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
      throw new Error("This graphics card cannot draw the blocks; the diagrams below work without.");
    gl.useProgram(program);
    buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    places = ["place", "normal", "colour"].map((name) => gl.getAttribLocation(program, name));
    places.forEach((place, i) => {
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 36, 12 * i);
    });
    gl.enable(gl.DEPTH_TEST);
    gl.polygonOffset(1, 1);
  }

  function move() {
    for (let b = 0; b < scene.blocks; b++) {
      const m = motionAt(scene, frame, b, motion);
      turn(magnification * m[3], magnification * m[4], magnification * m[5], shownTurn);
      turn(m[3], m[4], m[5], trueTurn);
      turns.set(shownTurn, 9 * b);
      for (let v = scene.vertexStart[b]; v < scene.vertexStart[b + 1]; v++) {
        const x = scene.vertices[3 * v], y = scene.vertices[3 * v + 1], z = scene.vertices[3 * v + 2];
        let size = 0;
        for (let i = 0; i < 3; i++) {
          const shift = shownTurn[3 * i] * x + shownTurn[3 * i + 1] * y + shownTurn[3 * i + 2] * z;
          const exact = trueTurn[3 * i] * x + trueTurn[3 * i + 1] * y + trueTurn[3 * i + 2] * z + m[i];
          moved[3 * v + i] = scene.places[3 * b + i] + (i === 0 ? x : i === 1 ? y : z) + shift + magnification * m[i];
          size += exact * exact;
        }
        amount[v] = Math.sqrt(size);
      }
    }
  }

  // What the colour of a corner of block b shows, as a part of the greatest: its displacement, or a value of its block.
  function shade(v, b) {
    if (paint === null) return cividis(amount[v] / scene.most);
    if (!paint.values) return STONE;
    const value = paint.values[Math.round(frame) * scene.blocks + b];
    return Number.isNaN(value) ? STONE : cividis(value / paint.most);
  }

  function fill() {
    for (let t = 0; t < count; t++) {
      const v = parts.vertex[t], b = scene.blockOf[v], x = parts.normal[3 * t], y = parts.normal[3 * t + 1], z = parts.normal[3 * t + 2];
      const colour = scene.fixed[b] ? STONE : shade(v, b);
      for (let i = 0; i < 3; i++) {
        points[9 * t + i] = moved[3 * v + i];
        points[9 * t + 3 + i] = parts.normal[3 * t + i] + turns[9 * b + 3 * i] * x + turns[9 * b + 3 * i + 1] * y + turns[9 * b + 3 * i + 2] * z;
        points[9 * t + 6 + i] = colour[i];
      }
    }
    parts.edges.forEach((v, t) => {
      const fixed = scene.fixed[scene.blockOf[v]];
      for (let i = 0; i < 3; i++) {
        lines[9 * t + i] = moved[3 * v + i];
        lines[9 * t + 6 + i] = 0.05;
        rest[9 * t + i] = fixed ? moved[3 * v + i] : scene.places[3 * scene.blockOf[v] + i] + scene.vertices[3 * v + i];
        rest[9 * t + 6 + i] = fixed ? 0.05 : 0.5;
      }
    });
  }

  // Where a point of block b is drawn.
  function carried(b, point) {
    const m = motionAt(scene, frame, b, motion), arm = minus(point, [0, 1, 2].map((i) => scene.places[3 * b + i]));
    turn(magnification * m[3], magnification * m[4], magnification * m[5], shownTurn);
    return [0, 1, 2].map((i) => point[i] + magnification * m[i]
      + shownTurn[3 * i] * arm[0] + shownTurn[3 * i + 1] * arm[1] + shownTurn[3 * i + 2] * arm[2]);
  }

  // The arrow of a load ends where its line of action meets the stone, so that it is never hidden inside.
  function arrow(load, share, colour, out) {
    const length = Math.max(Math.abs(share * load.size), 0.02) * 0.4 * scene.reach, way = load.direction.map((x) => (share < 0 ? -x : x));
    const [shift, pulls] = load.ends[share < 0 ? 1 : 0];
    rod(plus(carried(load.block, load.point), way, pulls ? shift : shift - length), way, length, 0.012 * scene.reach,
      Math.min(0.11 * scene.reach, 0.6 * length), colour, out);
  }

  function marks() {
    const out = [], share = scene.loadAt(frame);
    for (const load of scene.actuators) arrow(load, share, ACTUATOR, out);
    for (const load of scene.loads) arrow(load, 1, DEAD, out);
    for (const tie of scene.ties) {
      const from = carried(tie.blocks[0], tie.points[0]), along = minus(carried(tie.blocks[1], tie.points[1]), from);
      const length = Math.hypot(...along) || 1e-12;
      rod(from, along.map((x) => x / length), length, 0.008 * scene.reach, 0, TIE, out);
    }
    const rest = scene.centreAt(frame);
    if (rest) {
      const centre = carried(scene.centre.block, rest);
      const half = 0.5 * scene.centre.length;
      rod(plus(centre, scene.centre.axis, -half), scene.centre.axis, 2 * half, 0.008 * scene.reach, 0, CENTRE, out);
    }
    return Float32Array.from(out);
  }

  function draw() {
    waiting = false;
    if (gl.isContextLost()) return;
    const dots = Math.min(window.devicePixelRatio || 1, 2);
    const wide = Math.max(1, Math.round(canvas.clientWidth * dots)), high = Math.max(1, Math.round(canvas.clientHeight * dots));
    if (canvas.width !== wide || canvas.height !== high) { canvas.width = wide; canvas.height = high; }
    gl.viewport(0, 0, wide, high);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const distance = near * scene.reach / Math.tan(0.24) * 1.08;
    const eye = [Math.cos(height) * Math.cos(angle), Math.cos(height) * Math.sin(angle), Math.sin(height)].map((x) => distance * x);
    const up = [-Math.sin(height) * Math.cos(angle), -Math.sin(height) * Math.sin(angle), Math.cos(height)];
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "camera"), false, perspective(eye, up, scene.reach, wide / high));
    gl.uniform3fv(gl.getUniformLocation(program, "eye"), eye);
    const send = (data, mode) => {
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
      gl.drawArrays(mode, 0, data.length / 9);
    };
    gl.enable(gl.POLYGON_OFFSET_FILL);
    send(points, gl.TRIANGLES);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    send(lines, gl.LINES);
    send(rest, gl.LINES);
    send(marks(), gl.TRIANGLES);
  }

  function ask() {
    if (!waiting) { waiting = true; requestAnimationFrame(draw); }
  }

  function orbit(right, up) {
    angle -= right;
    height = Math.min(NEAR_POLE, Math.max(-NEAR_POLE, height + up));
    ask();
  }

  function come(factor) {
    near = Math.min(6, Math.max(0.15, near * factor));
    ask();
  }

  const held = new Map();
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, event); });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => held.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    if (held.size === 1) orbit((event.clientX - before.clientX) / 150, (event.clientY - before.clientY) / 150);
    else if (held.size === 2) {
      const other = [...held.values()].find((one) => one.pointerId !== event.pointerId);
      const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
      come((apart(before) + 1) / (apart(event) + 1));
    }
    held.set(event.pointerId, event);
  });
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); come(Math.exp(Math.sign(event.deltaY) * 0.1)); }, {passive: false});
  canvas.addEventListener("keydown", (event) => {
    const turnBy = {ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1]}[event.key];
    if (turnBy) orbit(...turnBy);
    else if (event.key === "+" || event.key === "=") come(0.9);
    else if (event.key === "-") come(1.1);
    else return;
    event.preventDefault();
  });
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => { prepare(); ask(); });
  new ResizeObserver(ask).observe(canvas);
  prepare();

  return {
    show(newFrame, newMagnification) {
      frame = newFrame;
      magnification = newMagnification;
      move();
      fill();
      ask();
    },
    // By {values, most}, values of the blocks frame after frame; by nothing without values; by displacement where null.
    paint(newPaint) {
      paint = newPaint;
      fill();
      ask();
    },
    look(name) {
      const [x, y, z] = unit(VIEWS[name]);
      height = Math.max(-NEAR_POLE, Math.min(NEAR_POLE, Math.asin(z)));
      angle = Math.abs(z) > 0.999 ? -Math.PI / 2 : Math.atan2(y, x);
      near = 1;
      ask();
    },
  };
}
