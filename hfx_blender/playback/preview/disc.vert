// SPDX-License-Identifier: GPL-3.0-or-later
// A disc with a rim, and around it a halo that fades out: rings 1 to 4.
void main()
{
  int row = int(corner.w) * 2;
  vec3 place = rows[row].xyz;
  vec3 normal = normalize(rows[row + 1].xyz);
  float share = rows[row].w;
  vec3 colour = share < 0.0 ? cold : full.rgb;
  share = abs(share);
  float glow = sqrt(share);
  int ring = int(corner.z);

  vec3 inner = mix(OFF, colour, glow);
  inner += (vec3(1.0) - colour) * 0.45 * glow;
  shade = vec4(ring < 2 ? inner : colour, 1.0);
  if (ring == 2) {
    shade.rgb = clamp(mix(inner, vec3(1.0), RIM), 0.0, 1.0);
  }
  if (ring > 2) {
    shade.a = ring == 3 ? 0.75 * glow : 0.0;
  }

  float radius = full.w * (ring == 0 ? 0.0 : (ring == 1 ? 0.8 : 1.0));
  if (ring == 4) {
    radius *= 1.0 + (HALO - 1.0) * share;
  }
  vec3 across = abs(normal.z) < 0.9 ? vec3(normal.y, -normal.x, 0.0) :
                                      vec3(0.0, normal.z, -normal.y);
  across = normalize(across);
  vec3 offset = corner.x * across + corner.y * cross(normal, across);
  vec3 at = place + normal * above + radius / scale * offset;
  gl_Position = ModelViewProjectionMatrix * vec4(at, 1.0);
}
