// The shapes of mesorig-view (renderer/shapes/scene.c and mesh_shape.c): meshes with texture
// coordinates, tangent frames, scale and curvature, ready to be drawn with mesh.vert.

// number of floats of a vertex: position 3, normal 3, tangent 4, uv 2
const stride = 12;
// number of floats of the local shape at a vertex: lengths of a step of 1 in u and in v (2), second
// fundamental form (3), gradients of ln scale along tangent and bitangent (4)
export const shapeStride = 9;

const attributes = [["position", 3, 0], ["normal", 3, 3], ["tangent", 4, 6], ["uv", 2, 10]];
// name, number of floats, first float
export const shapeAttributes = [["scale", 2, 0], ["bend", 3, 2], ["stretch", 4, 5]];

const TAU = 2 * Math.PI;

function plane(u, v) {
  return [2 * u - 1, 2 * v - 1, 0, 0, 0, 1, 1, 0, 0];
}

function torus(u, v) {
  const a = TAU * u, b = TAU * v, r = 1 + 0.4 * Math.cos(b);
  return [r * Math.cos(a), r * Math.sin(a), 0.4 * Math.sin(b),
    Math.cos(b) * Math.cos(a), Math.cos(b) * Math.sin(a), Math.sin(b), -Math.sin(a), Math.cos(a), 0];
}

function sphere(u, v) {
  const a = TAU * u, b = Math.PI * (v - 0.5);
  const n = [Math.cos(b) * Math.cos(a), Math.cos(b) * Math.sin(a), Math.sin(b)];
  return [...n, ...n, -Math.sin(a), Math.cos(a), 0];
}

const cylinderRadius = 0.6, cylinderHeight = 1.6;

function cylinder(u, v) {
  const a = TAU * u;
  return [cylinderRadius * Math.cos(a), cylinderRadius * Math.sin(a), cylinderHeight * (v - 0.5),
    Math.cos(a), Math.sin(a), 0, -Math.sin(a), Math.cos(a), 0];
}

function knotCurve(t) {
  const r = 2 + Math.cos(3 * t);
  return [r * Math.cos(2 * t), r * Math.sin(2 * t), Math.sin(3 * t)];
}

// Returns position and normal of the (2, 3) torus knot. The angle around its tube is counted from
// the upper side.
function knotAt(u, v) {
  const t = TAU * u, b = TAU * v, middle = knotCurve(t);
  const from = knotCurve(t - 1e-4), to = knotCurve(t + 1e-4);
  const direction = to.map((x, k) => x - from[k]), length = Math.hypot(...direction);
  const d = direction.map(x => x / length);
  const rest = [-d[2] * d[0], -d[2] * d[1], 1 - d[2] * d[2]], outLength = Math.hypot(...rest);
  const out = rest.map(x => x / outLength);
  const aside = [0, 1, 2].map(k => out[(k + 1) % 3] * d[(k + 2) % 3] - out[(k + 2) % 3] * d[(k + 1) % 3]);
  const normal = out.map((x, k) => Math.cos(b) * x + Math.sin(b) * aside[k]);
  return { position: middle.map((x, k) => 0.42 * x + 0.18 * normal[k]), normal };
}

function knot(u, v) {
  const { position, normal } = knotAt(u, v);
  const before = knotAt(u - 1e-4, v).position, after = knotAt(u + 1e-4, v).position;
  const t = after.map((x, k) => x - before[k]);
  const off = t[0] * normal[0] + t[1] * normal[1] + t[2] * normal[2];
  const tangent = t.map((x, k) => x - off * normal[k]), length = Math.hypot(...tangent);
  return [...position, ...normal, ...tangent.map(x => x / length)];
}

// Returns a mesh of nu × nv squares. point(u, v) gives position, normal and tangent for u and v from
// 0 to 1.
function grid(point, nu, nv) {
  const vertices = [], indices = [];
  for (let j = 0; j <= nv; j++)
    for (let i = 0; i <= nu; i++) vertices.push(...point(i / nu, j / nv), 1, i / nu, j / nv);
  for (let j = 0; j < nv; j++)
    for (let i = 0; i < nu; i++) {
      const a = j * (nu + 1) + i, b = a + 1, c = a + nu + 1, d = c + 1;
      indices.push(a, b, d, a, d, c);
    }
  return { vertices, indices };
}

// Adds a flat end of the cylinder that faces up (side 1) or down (side −1). Its texels have about
// the size of those on the cylinder.
function addLid(mesh, n, side) {
  const first = mesh.vertices.length / stride;
  for (let k = 0; k <= n; k++) {
    const r = k === n ? 0 : cylinderRadius, a = TAU * k / n;
    const x = r * Math.cos(a), y = r * Math.sin(a);
    mesh.vertices.push(x, y, 0.5 * side * cylinderHeight, 0, 0, side, 1, 0, 0, 1,
      x / (TAU * cylinderRadius), side * y / cylinderHeight);
  }
  for (let k = 0; k < n; k++) {
    const a = first + k, b = first + (k + 1) % n;
    mesh.indices.push(first + n, side > 0 ? a : b, side > 0 ? b : a);
  }
}

function closedCylinder() {
  const mesh = grid(cylinder, 128, 1);
  addLid(mesh, 128, 1);
  addLid(mesh, 128, -1);
  return mesh;
}

// tiles is the suggested number of repetitions of the material. layers is the number of parts of
// the shape that may lie behind each other.
const shapes = {
  torus: { make: () => grid(torus, 192, 96), tiles: [8, 3], layers: 3 },
  sphere: { make: () => grid(sphere, 128, 64), tiles: [6, 3], layers: 2 },
  plane: { make: () => grid(plane, 1, 1), tiles: [2, 2], layers: 1 },
  cylinder: { make: closedCylinder, tiles: [5, 2], layers: 2 },
  "torus-knot": { make: () => grid(knot, 768, 48), tiles: [24, 2], layers: 8 },
};
export const shapeNames = Object.keys(shapes);

// Number of sums over the triangles around a vertex, in this order: area; area × scale of u; area ×
// scale of v; then over the edges aa, ab, bb, pa, pb + qa, qb. (a, b) is an edge and (p, q) the
// change of the normal along it, both in the tangent frame. Least squares over them give the second
// fundamental form. The last four are the changes of ln scale of u, times a and times b, and those
// of v. Least squares over them give the gradients of ln scale.
const sums = 13;

// Adds the area of a triangle, and its scales of u and v times the area, to its corners.
function addScale(v, corners, total) {
  const [p, q, r] = corners.map(k => k * stride);
  const e1 = [0, 1, 2].map(k => v[q + k] - v[p + k]), e2 = [0, 1, 2].map(k => v[r + k] - v[p + k]);
  const u1 = v[q + 10] - v[p + 10], v1 = v[q + 11] - v[p + 11];
  const u2 = v[r + 10] - v[p + 10], v2 = v[r + 11] - v[p + 11];
  const area = Math.hypot(e1[1] * e2[2] - e1[2] * e2[1], e1[2] * e2[0] - e1[0] * e2[2],
    e1[0] * e2[1] - e1[1] * e2[0]);
  const turn = u1 * v2 - u2 * v1;
  if (turn === 0 || area === 0) return;
  const du = Math.hypot(...e1.map((x, k) => (v2 * x - v1 * e2[k]) / turn));
  const dv = Math.hypot(...e1.map((x, k) => (u1 * e2[k] - u2 * x) / turn));
  for (const corner of corners) {
    total[sums * corner] += area;
    total[sums * corner + 1] += area * du;
    total[sums * corner + 2] += area * dv;
  }
}

// Returns the bitangent of a vertex.
function bitangent(v, corner) {
  const c = corner * stride;
  const n = [v[c + 3], v[c + 4], v[c + 5]], t = [v[c + 6], v[c + 7], v[c + 8]], sign = v[c + 9];
  return [sign * (n[1] * t[2] - n[2] * t[1]), sign * (n[2] * t[0] - n[0] * t[2]),
    sign * (n[0] * t[1] - n[1] * t[0])];
}

// Adds an edge to the sums of a vertex for the second fundamental form.
function addEdge(v, corner, from, to, total) {
  const t = corner * stride + 6, f = from * stride, g = to * stride, at = sums * corner;
  const s = bitangent(v, corner);
  let a = 0, b = 0, p = 0, q = 0;
  for (let k = 0; k < 3; k++) {
    const edge = v[g + k] - v[f + k], change = v[g + 3 + k] - v[f + 3 + k];
    a += edge * v[t + k];
    b += edge * s[k];
    p += change * v[t + k];
    q += change * s[k];
  }
  total[at + 3] += a * a;
  total[at + 4] += a * b;
  total[at + 5] += b * b;
  total[at + 6] += p * a;
  total[at + 7] += p * b + q * a;
  total[at + 8] += q * b;
}

// Returns the second fundamental form (L, M, N): solves (aa, ab, 0; ab, aa + bb, ab; 0, ab, bb) (L,
// M, N) = (pa, pb + qa, qb).
function solve(total, at) {
  const slack = 1e-9 * (total[at + 3] + total[at + 5]) + Number.MIN_VALUE;
  const aa = total[at + 3] + slack, bb = total[at + 5] + slack, ab = total[at + 4];
  const [pa, both, qb] = [total[at + 6], total[at + 7], total[at + 8]];
  const middle = aa + bb - ab * ab / aa - ab * ab / bb;
  const m = middle > slack ? (both - ab * pa / aa - ab * qb / bb) / middle : 0;
  return [(pa - ab * m) / aa, m, (qb - ab * m) / bb].map(x => (Number.isFinite(x) ? x : 0));
}

// Adds the changes of ln scale from one end of an edge to the other. shape has the scales.
function addChange(v, corner, from, to, shape, total) {
  const t = corner * stride + 6, f = from * stride, g = to * stride, at = sums * corner + 9;
  const s = bitangent(v, corner);
  let a = 0, b = 0;
  for (let k = 0; k < 3; k++) {
    a += (v[g + k] - v[f + k]) * v[t + k];
    b += (v[g + k] - v[f + k]) * s[k];
  }
  for (let c = 0; c < 2; c++) {
    const change = Math.log(shape[shapeStride * to + c] / shape[shapeStride * from + c]);
    total[at + 2 * c] += change * a;
    total[at + 2 * c + 1] += change * b;
  }
}

// Returns the gradients of ln scale (u along t, u along b, v along t, v along b): solves (aa, ab; ab,
// bb) (∂t, ∂b) = (change · a, change · b) for u and for v.
function solveStretch(total, at) {
  const aa = total[at + 3], ab = total[at + 4], bb = total[at + 5], determinant = aa * bb - ab * ab;
  const ret = [0, 0, 0, 0];
  if (!(determinant > 1e-9 * (aa + bb) ** 2)) return ret;
  for (let c = 0; c < 2; c++) {
    const [a, b] = [total[at + 9 + 2 * c], total[at + 10 + 2 * c]];
    ret[2 * c] = (bb * a - ab * b) / determinant;
    ret[2 * c + 1] = (aa * b - ab * a) / determinant;
  }
  return ret.map(x => (Number.isFinite(x) ? x : 0));
}

// Calls use(corner, from, to) for each vertex of a triangle and each edge of the triangle.
function forEachEdge(indices, use) {
  for (let k = 0; k < indices.length; k += 3)
    for (let c = 0; c < 3; c++)
      for (let e = 0; e < 3; e++) use(indices[k + c], indices[k + e], indices[k + (e + 1) % 3]);
}

// Returns shapeStride numbers per vertex: the shapeAttributes of mesh.vert. vertices has stride
// numbers per vertex.
export function vertexShapes(vertices, indices) {
  const n = vertices.length / stride, total = new Float64Array(sums * n);
  for (let k = 0; k < indices.length; k += 3)
    addScale(vertices, [indices[k], indices[k + 1], indices[k + 2]], total);
  forEachEdge(indices, (corner, from, to) => addEdge(vertices, corner, from, to, total));
  const ret = new Float32Array(shapeStride * n);
  for (let k = 0; k < n; k++) {
    const at = sums * k, area = total[at];
    for (let c = 0; c < 2; c++)
      ret[shapeStride * k + c] = Math.max(area > 0 ? total[at + 1 + c] / area : 1, 1e-6);
    ret.set(solve(total, at), shapeStride * k + 2);
  }
  forEachEdge(indices, (corner, from, to) => addChange(vertices, corner, from, to, ret, total));
  for (let k = 0; k < n; k++) ret.set(solveStretch(total, sums * k), shapeStride * k + 5);
  return ret;
}

// A shape on the GPU. points has a copy of the positions. For tiles and layers, see shapes.
export class Mesh {
  constructor(gl, vertices, indices, tiles, layers) {
    this.vertices = new Float32Array(vertices);
    this.indices = new Uint32Array(indices);
    this.gl = gl;
    this.tiles = tiles;
    this.layers = layers;
    this.radius = 0;
    this.points = new Float32Array(this.vertices.length / stride * 3);
    for (let k = 0; k < this.points.length; k += 3) {
      const p = this.vertices.subarray(k / 3 * stride, k / 3 * stride + 3);
      this.points.set(p, k);
      this.radius = Math.max(this.radius, Math.hypot(p[0], p[1], p[2]));
    }
    this.upload(vertexShapes(this.vertices, this.indices));
  }

  static named(gl, name) {
    const { make, tiles, layers } = shapes[name], { vertices, indices } = make();
    return new Mesh(gl, vertices, indices, tiles, layers);
  }

  upload(shape) {
    const gl = this.gl;
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    let location = 0;
    this.buffers = [[this.vertices, stride, attributes], [shape, shapeStride, shapeAttributes]]
      .map(([values, step, list]) => {
        const buffer = gl.createBuffer();
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
        for (const [, size, at] of list) {
          gl.enableVertexAttribArray(location);
          gl.vertexAttribPointer(location++, size, gl.FLOAT, false, 4 * step, 4 * at);
        }
        return buffer;
      });
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, this.indices, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    this.buffers.push(buffer);
  }

  draw() {
    const gl = this.gl;
    gl.bindVertexArray(this.array);
    gl.drawElements(gl.TRIANGLES, this.indices.length, gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
  }

  free() {
    this.gl.deleteVertexArray(this.array);
    this.buffers.forEach(buffer => this.gl.deleteBuffer(buffer));
  }
}
