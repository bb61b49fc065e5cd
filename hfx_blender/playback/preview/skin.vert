// SPDX-License-Identifier: GPL-3.0-or-later
// Premultiplied, so that a colour fades out at its edge without turning dark.
void main()
{
  gl_Position = ModelViewProjectionMatrix * vec4(pos + normal * above, 1.0);
  float facing = clamp(dot(normal, to_viewer), 0.0, 1.0);
  float alpha = colour.a * opacity;
  shade = vec4(colour.rgb * mix(DARKEST, 1.0, facing) * alpha, alpha);
}
