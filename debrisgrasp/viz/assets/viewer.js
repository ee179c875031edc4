"use strict";
// A small viewer for points, flat-shaded meshes and lines, in plain WebGL 2.

const POINT_VERTEX = `#version 300 es
uniform mat4 uProjection; uniform float uScale; uniform vec3 uShown; uniform float uSizeStep;
in vec3 aPosition; in vec3 aColor; in float aKind; in float aSize;
out vec3 vColor;
void main() {
  gl_Position = uProjection * vec4(aPosition, 1.0);
  float shown = aKind < 0.5 ? uShown.x : aKind < 1.5 ? uShown.y : uShown.z;
  if (shown < 0.5) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = clamp(uScale * aSize * uSizeStep / gl_Position.w, 1.5, 48.0);
  vColor = aColor;
}`;
const POINT_FRAGMENT = `#version 300 es
precision mediump float; in vec3 vColor; out vec4 color;
void main() {
  vec2 d = gl_PointCoord - 0.5;
  if (dot(d, d) > 0.25) discard;
  color = vec4(vColor, 1.0);
}`;
const MESH_VERTEX = `#version 300 es
uniform mat4 uProjection; uniform mat4 uModel; in vec3 aPosition; out vec3 vPosition;
void main() {
  vec4 position = uModel * vec4(aPosition, 1.0);
  vPosition = position.xyz;
  gl_Position = uProjection * position;
}`;
const MESH_FRAGMENT = `#version 300 es
precision highp float; uniform vec4 uColor; uniform vec3 uEye; in vec3 vPosition; out vec4 color;
void main() {
  vec3 n = normalize(cross(dFdx(vPosition), dFdy(vPosition)));
  vec3 to_eye = normalize(uEye - vPosition);
  if (dot(n, to_eye) < 0.0) n = -n;
  vec3 lamp = normalize(to_eye + vec3(0.0, 0.0, 0.9));
  float light = 0.40 + 0.18 * (0.5 + 0.5 * n.z) + 0.5 * max(dot(n, lamp), 0.0);
  color = vec4(uColor.rgb * light, 1.0) * uColor.a;
}`;
const LINE_FRAGMENT = `#version 300 es
precision mediump float; uniform vec4 uColor; in vec3 vPosition; out vec4 color;
void main() { color = vec4(uColor.rgb, 1.0) * uColor.a; }`;

function bytesOf(text) {
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
}

// Positions written as low + step * 16-bit integer.
function positionsOf(packed) {
  const steps = new Uint16Array(bytesOf(packed.at).buffer);
  const out = new Float32Array(steps.length);
  for (let i = 0; i < steps.length; i++) out[i] = packed.low[i % 3] + packed.step * steps[i];
  return out;
}

function facesOf(mesh) {
  return new Uint32Array(bytesOf(mesh.faces).buffer);
}

const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((x) => x / n); };

// Column-major product of two 4x4 matrices.
function product(a, b) {
  const out = new Array(16).fill(0);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++)
    out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}

class Viewer {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: true, premultipliedAlpha: true });
    if (!this.gl) throw new Error("WebGL 2 is missing");
    this.programs = {
      points: this.program(POINT_VERTEX, POINT_FRAGMENT),
      mesh: this.program(MESH_VERTEX, MESH_FRAGMENT),
      line: this.program(MESH_VERTEX, LINE_FRAGMENT),
    };
    this.items = new Map();
    this.camera = { target: [0, 0, 0], distance: 2, cut: 0.02, yaw: 0, pitch: 0.6 };
    this.kinds = [1, 1, 1];
    this.background = [0.96, 0.97, 0.98];
    this.listen();
    new ResizeObserver(() => this.redraw()).observe(canvas);
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    return program;
  }

  attribute(program, name, data, size, type, normalized) {
    const gl = this.gl, place = gl.getAttribLocation(program, name), buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, normalized, 0, 0);
    return buffer;
  }

  // Items are drawn in the order in which they were added; one of the same name is replaced.
  put(name, item) {
    const old = this.items.get(name);
    if (old) {
      old.buffers.forEach((buffer) => this.gl.deleteBuffer(buffer));
      this.gl.deleteVertexArray(old.array);
    }
    this.items.set(name, { shown: true, alpha: 1, model: IDENTITY, ...old?.style, ...item });
    this.redraw();
  }

  points(name, { positions, colors, kinds, sizes, sizeStep }) {
    const gl = this.gl, p = this.programs.points, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = [
      this.attribute(p, "aPosition", positions, 3, gl.FLOAT, false),
      this.attribute(p, "aColor", colors, 3, gl.UNSIGNED_BYTE, true),
      this.attribute(p, "aKind", kinds, 1, gl.UNSIGNED_BYTE, false),
      this.attribute(p, "aSize", sizes, 1, gl.UNSIGNED_BYTE, false),
    ];
    this.put(name, { type: "points", array, buffers, count: positions.length / 3, sizeStep });
  }

  mesh(name, positions, faces, color, style = {}) {
    const gl = this.gl, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = [this.attribute(this.programs.mesh, "aPosition", positions, 3, gl.FLOAT, false)];
    const index = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, index);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    buffers.push(index);
    this.put(name, { type: "mesh", array, buffers, count: faces.length, color, ...style });
  }

  lines(name, positions, color, style = {}) {
    const gl = this.gl, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = [this.attribute(this.programs.line, "aPosition", positions, 3, gl.FLOAT, false)];
    this.put(name, { type: "line", array, buffers, count: positions.length / 3, color, ...style });
  }

  set(name, change) {
    const item = this.items.get(name);
    if (item) Object.assign(item, change);
    this.redraw();
  }

  eye() {
    const { target, distance, yaw, pitch } = this.camera;
    const level = Math.cos(pitch) * distance;
    return [target[0] + level * Math.cos(yaw), target[1] + level * Math.sin(yaw),
      target[2] + Math.sin(pitch) * distance];
  }

  axes() {
    const back = unit(subtract(this.eye(), this.camera.target));
    const { yaw } = this.camera;
    const right = [-Math.sin(yaw), Math.cos(yaw), 0];
    return { back, right, up: cross(back, right) };
  }

  // What is nearer to the eye than the share `cut` of the distance is left out.
  lookFrom(eye, target, cut = 0.02) {
    const d = subtract(eye, target), distance = Math.hypot(...d);
    this.camera = {
      target: [...target], distance, cut, yaw: Math.atan2(d[1], d[0]),
      pitch: Math.asin(Math.max(-1, Math.min(1, d[2] / (distance || 1)))),
    };
    this.redraw();
  }

  redraw() {
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => { this.pending = 0; this.draw(); });
  }

  draw() {
    const gl = this.gl, ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(this.canvas.clientWidth * ratio);
    const height = Math.round(this.canvas.clientHeight * ratio);
    if (!width || !height) return;
    if (this.canvas.width !== width || this.canvas.height !== height)
      Object.assign(this.canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(...this.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);

    const f = 1 / Math.tan(0.35), near = this.camera.distance * this.camera.cut, far = this.camera.distance * 20 + 20;
    const lens = [f * height / width, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1,
      0, 0, 2 * far * near / (near - far), 0];
    const eye = this.eye(), { back, right, up } = this.axes();
    const look = [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
      -dot(right, eye), -dot(up, eye), -dot(back, eye), 1];
    const projection = product(lens, look);

    // What is translucent comes last, and does not hide what is behind it.
    const items = [...this.items.values()].filter((item) => item.shown && item.count);
    for (const item of [...items.filter((i) => i.alpha >= 1), ...items.filter((i) => i.alpha < 1)]) {
      const program = this.programs[item.type], at = (name) => gl.getUniformLocation(program, name);
      gl.useProgram(program);
      gl.bindVertexArray(item.array);
      gl.uniformMatrix4fv(at("uProjection"), false, projection);
      if (item.type === "points") {
        gl.uniform1f(at("uScale"), f * height / 2);
        gl.uniform1f(at("uSizeStep"), item.sizeStep);
        gl.uniform3fv(at("uShown"), this.kinds);
        gl.drawArrays(gl.POINTS, 0, item.count);
        continue;
      }
      const isSolid = item.alpha >= 1;
      (isSolid ? gl.disable : gl.enable).call(gl, gl.BLEND);
      gl.depthMask(isSolid);
      gl.uniformMatrix4fv(at("uModel"), false, item.model);
      gl.uniform4f(at("uColor"), ...item.color, item.alpha);
      gl.uniform3fv(at("uEye"), eye);
      if (item.type === "mesh") gl.drawElements(gl.TRIANGLES, item.count, gl.UNSIGNED_INT, 0);
      else gl.drawArrays(gl.LINES, 0, item.count);
      gl.depthMask(true);
      gl.disable(gl.BLEND);
    }
  }

  listen() {
    const canvas = this.canvas, fingers = new Map();
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, event);
    });
    for (const end of ["pointerup", "pointercancel"])
      canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const last = fingers.get(event.pointerId);
      if (!last) return;
      const dx = event.clientX - last.clientX, dy = event.clientY - last.clientY;
      if (fingers.size === 2) {
        const other = [...fingers.values()].find((f) => f.pointerId !== event.pointerId);
        const span = (e) => Math.hypot(e.clientX - other.clientX, e.clientY - other.clientY) || 1;
        this.camera.distance *= span(last) / span(event);
        this.pan(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons === 2 || event.buttons === 4) {
        this.pan(dx, dy);
      } else {
        this.camera.cut = 0.02;
        this.camera.yaw -= dx * 0.008;
        this.camera.pitch = Math.max(-1.5, Math.min(1.57, this.camera.pitch + dy * 0.008));
      }
      fingers.set(event.pointerId, event);
      this.redraw();
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.camera.distance *= Math.exp(Math.max(-100, Math.min(100, event.deltaY)) * 0.0015);
      this.redraw();
    }, { passive: false });
  }

  pan(dx, dy) {
    const scale = 2 * Math.tan(0.35) * this.camera.distance / this.canvas.clientHeight;
    const { right, up } = this.axes();
    this.camera.target = this.camera.target.map((x, i) => x - scale * (dx * right[i] - dy * up[i]));
  }
}
