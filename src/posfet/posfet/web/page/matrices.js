// 4 x 4 matrices, column by column as WebGL takes them.

export function multiplied(a, b) {
  const result = new Float32Array(16);
  for (let column = 0; column < 4; column += 1)
    for (let row = 0; row < 4; row += 1)
      for (let k = 0; k < 4; k += 1) result[column * 4 + row] += a[k * 4 + row] * b[column * 4 + k];
  return result;
}

/** Perspective with a vertical opening angle [rad]. */
export function perspective(angle, aspect, near, far) {
  const f = 1 / Math.tan(angle / 2);
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
}

/** View on an object scaled by `scale`: turned by `yaw` around z, seen from `pitch` above the horizon, `lift`ed. */
export function turned(yaw, pitch, distance, scale, lift) {
  const cy = Math.cos(yaw), sy = Math.sin(yaw), cp = Math.cos(pitch), sp = Math.sin(pitch);
  return new Float32Array([
    scale * cy, scale * sy * sp, -scale * sy * cp, 0,
    -scale * sy, scale * cy * sp, -scale * cy * cp, 0,
    0, scale * cp, scale * sp, 0,
    0, lift, -distance, 1,
  ]);
}
