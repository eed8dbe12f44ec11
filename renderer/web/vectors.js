// Vectors of three numbers, and matrices as in OpenGL: sixteen numbers, column by column.

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export const cross = (a, b) =>
  [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

// Returns a + s b.
export const along = (a, s, b) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];

// Returns the unit vector along a.
export function unit(a) {
  const length = Math.hypot(a[0], a[1], a[2]);
  return [a[0] / length, a[1] / length, a[2] / length];
}

// Returns the unit vector for a polar angle from +z and an azimuth from +x, counter-clockwise.
export function directionFromDeg(thetaDeg, phiDeg) {
  const theta = thetaDeg * Math.PI / 180, phi = phiDeg * Math.PI / 180;
  return [Math.sin(theta) * Math.cos(phi), Math.sin(theta) * Math.sin(phi), Math.cos(theta)];
}

// Returns the matrix a b.
export function product(a, b) {
  const ret = new Array(16).fill(0);
  for (let k = 0; k < 16; k++)
    for (let i = 0; i < 4; i++) ret[k] += a[4 * i + k % 4] * b[4 * Math.floor(k / 4) + i];
  return ret;
}
