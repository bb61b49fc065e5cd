// SPDX-License-Identifier: GPL-3.0-or-later
// Colours of a viewport are stored as sRGB by the card, which then wants light; Blender sets
// srgbTarget for that, as for its own shaders.
vec3 to_target(vec3 colour)
{
  vec3 low = colour / 12.92;
  vec3 high = pow((max(colour, vec3(0.0)) + 0.055) / 1.055, vec3(2.4));
  vec3 light = mix(low, high, step(vec3(0.04045), colour));
  return srgbTarget ? light : colour;
}

void main()
{
  vec3 colour = shade.rgb / max(shade.a, 1e-6);
  seen = vec4(to_target(colour) * shade.a, shade.a);
}
