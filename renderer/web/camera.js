// The camera of mesorig-view (renderer/scene/camera.c).
import { along, cross, directionFromDeg, dot, product } from "./vectors.js";

const margin = 0.92; // share of the picture's width or height that a shape fills

// Returns the unit vectors to the right, upwards, and back towards the eye.
function axesOf(settings) {
  const back = directionFromDeg(90 - settings.cameraElevationDeg, settings.cameraAzimuthDeg);
  const up = directionFromDeg(-settings.cameraElevationDeg, settings.cameraAzimuthDeg);
  return { right: cross(up, back), up, back };
}

// Returns the tangents of half the field of view: across and upwards.
function halfAngles(settings, aspect) {
  const half = Math.tan(0.5 * settings.cameraFovDeg * Math.PI / 180);
  return aspect >= 1 ? [half * aspect, half] : [half, half / aspect];
}

// Returns the pan along one axis of the picture at which the points, in perspective, extend equally
// far to both sides of the middle. Begins with `pan`.
function centre(points, axis, back, distance, pan) {
  for (let round = 0; round < 4; round++) {
    let low = Infinity, high = -Infinity;
    for (let k = 0; k < points.length; k += 3) {
      const p = [points[k], points[k + 1], points[k + 2]];
      const shown = (dot(p, axis) - pan) / Math.max(distance - dot(p, back), 1e-3 * distance);
      low = Math.min(low, shown);
      high = Math.max(high, shown);
    }
    pan += 0.5 * (low + high) * distance;
  }
  return pan;
}

// Returns the distance and pan, in radii, at which the points (x, y, z, x, …) fill the picture
// except for a margin.
export function fitCamera(settings, points, radius, aspect) {
  const { right, up, back } = axesOf(settings), [halfX, halfY] = halfAngles(settings, aspect);
  const fit = (axis, half) => {
    let high = -Infinity, low = -Infinity;
    for (let k = 0; k < points.length; k += 3) {
      const p = [points[k], points[k + 1], points[k + 2]], x = dot(p, axis), z = half * dot(p, back);
      high = Math.max(high, x + z);
      low = Math.max(low, z - x);
    }
    return { distance: 0.5 * (high + low) / half, pan: 0.5 * (high - low) };
  };
  const across = fit(right, halfX * margin), upwards = fit(up, halfY * margin);
  const distance = Math.max(across.distance, upwards.distance);
  return {
    cameraDistance: Math.min(Math.max(distance / radius, 0.01), 1000),
    cameraPan: [centre(points, right, back, distance, across.pan) / radius,
      centre(points, up, back, distance, upwards.pan) / radius],
  };
}

// Returns the matrix from world to eye coordinates.
function lookAt(eye, { right, up, back }) {
  return [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1];
}

// Returns the matrix from eye to clip coordinates. halfY is a tangent; see halfAngles().
function perspective(halfY, aspect, near, far) {
  const f = 1 / halfY, depth = 1 / (near - far);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (near + far) * depth, -1, 0, 0,
    2 * near * far * depth, 0];
}

// Returns the matrix from world to clip coordinates and the position of the eye. The settings must
// have a distance.
export function cameraMatrix(settings, radius, aspect) {
  const axes = axesOf(settings), [, halfY] = halfAngles(settings, aspect);
  const distance = settings.cameraDistance * radius, [panX, panY] = settings.cameraPan;
  let eye = along([0, 0, 0], panX * radius, axes.right);
  eye = along(along(eye, panY * radius, axes.up), distance, axes.back);
  const near = Math.max(distance - 1.05 * radius, 0.01 * radius);
  const lens = perspective(halfY, aspect, near, distance + 1.05 * radius);
  return { projection: product(lens, lookAt(eye, axes)), eye };
}
