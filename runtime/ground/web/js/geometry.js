// The little geometry that the page needs. Quaternions are Hamilton, in the order x y z w.

// Eigenvalues and eigenvectors of a symmetric 3x3 matrix [xx, xy, xz, yy, yz, zz] by cyclic Jacobi rotations
// (Golub and Van Loan, section 8.5), largest first; `vectors[k]` belongs to `values[k]`, right-handed.
// Null when a number is not finite.
export function eigenSymmetric(m) {
  if (!Array.isArray(m) || m.length !== 6 || !m.every(Number.isFinite)) return null;
  const a = [
    [m[0], m[1], m[2]],
    [m[1], m[3], m[4]],
    [m[2], m[4], m[5]],
  ];
  const v = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ];
  for (let sweep = 0; sweep < 30; sweep += 1) {
    const off = a[0][1] ** 2 + a[0][2] ** 2 + a[1][2] ** 2;
    const size = a[0][0] ** 2 + a[1][1] ** 2 + a[2][2] ** 2;
    if (off <= 1e-30 * (off + size)) break;
    for (const [p, q] of [[0, 1], [0, 2], [1, 2]]) rotate(a, v, p, q);
  }
  const order = [0, 1, 2].sort((i, j) => a[j][j] - a[i][i]);
  const values = order.map((i) => a[i][i]);
  const vectors = order.map((i) => [v[0][i], v[1][i], v[2][i]]);
  if (dot(cross(vectors[0], vectors[1]), vectors[2]) < 0) vectors[2] = vectors[2].map((x) => -x);
  return { values, vectors };
}

function rotate(a, v, p, q) {
  if (a[p][q] === 0) return;
  const theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
  const t = Math.sign(theta || 1) / (Math.abs(theta) + Math.hypot(theta, 1));
  const c = 1 / Math.hypot(t, 1);
  const s = t * c;
  for (let k = 0; k < 3; k += 1) [a[k][p], a[k][q]] = [c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]];
  for (let k = 0; k < 3; k += 1) [a[p][k], a[q][k]] = [c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]];
  for (let k = 0; k < 3; k += 1) [v[k][p], v[k][q]] = [c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]];
}

// The ellipsoid of `sigmas` standard deviations: semi-axes in metres, largest first, and their directions. Null when
// the covariance is unknown or not positive semidefinite (beyond rounding).
export function ellipsoid(covariance, sigmas = 3) {
  const eigen = eigenSymmetric(covariance);
  if (!eigen || eigen.values[0] < 0 || eigen.values[2] < -1e-9 * Math.max(eigen.values[0], 1e-12)) return null;
  return { semiAxes: eigen.values.map((x) => sigmas * Math.sqrt(Math.max(x, 0))), axes: eigen.vectors };
}

export function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export function norm(a) {
  return Math.hypot(a[0], a[1], a[2]);
}

// Turns `p` by the unit quaternion at `q[at..at + 4]`.
export function turn(q, at, p) {
  const x = q[at];
  const y = q[at + 1];
  const z = q[at + 2];
  const w = q[at + 3];
  const tx = 2 * (y * p[2] - z * p[1]);
  const ty = 2 * (z * p[0] - x * p[2]);
  const tz = 2 * (x * p[1] - y * p[0]);
  return [p[0] + w * tx + y * tz - z * ty, p[1] + w * ty + z * tx - x * tz, p[2] + w * tz + x * ty - y * tx];
}

// Edges of a frustum, as pairs of corners: 0 is the apex, 1 to 4 the picture.
const FRUSTUM_EDGES = [0, 1, 0, 2, 0, 3, 0, 4, 1, 2, 2, 3, 3, 4, 4, 1];
export const FRUSTUM_FLOATS = FRUSTUM_EDGES.length * 3;

// Pose of the left camera in the body, [x, y, z, qx, qy, qz, qw], for drawing keyframes: looking along the body's z, its
// right along the body's y, as in the rigs of EuRoC.
export const CAMERA_IN_BODY = [0, 0, 0, 0, 0, Math.SQRT1_2, Math.SQRT1_2];

// Small frusta of keyframes. `keyframes` holds the body's [x, y, z, qx, qy, qz, qw] per item, from item `from` to `to`;
// the result are end points of segments, FRUSTUM_FLOATS numbers per keyframe.
export function frusta(keyframes, from, to, size, camera = CAMERA_IN_BODY) {
  const out = new Float32Array((to - from) * FRUSTUM_FLOATS);
  const corners = frustumCorners(size).map((corner) => add(turn(camera, 3, corner), camera));
  let at = 0;
  for (let i = from; i < to; i += 1) {
    const o = i * 7;
    const position = [keyframes[o], keyframes[o + 1], keyframes[o + 2]];
    const placed = corners.map((corner) => add(turn(keyframes, o + 3, corner), position));
    for (const corner of FRUSTUM_EDGES) {
      out[at++] = placed[corner][0];
      out[at++] = placed[corner][1];
      out[at++] = placed[corner][2];
    }
  }
  return out;
}

// In the camera's frame: z forward, x right, y down.
function frustumCorners(size) {
  const w = 0.6 * size;
  const h = 0.4 * size;
  return [[0, 0, 0], [-w, -h, size], [w, -h, size], [w, h, size], [-w, h, size]];
}

function add(a, b) {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

// The spacing of a grid that is seen from `distance` metres: 1, 2 or 5 times a power of ten.
export function gridSpacing(distance) {
  const rough = Math.max(distance, 1e-3) / 12;
  const decade = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((m) => m * decade >= rough * 0.999) ?? 10;
  return step * decade;
}
