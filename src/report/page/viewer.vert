#version 300 es
// A Gaussian's quad: mean, scales and rotation unpacked, the covariance projected as training does.
precision highp float;
precision highp int;
uniform highp usampler2D gaussians;
uniform mat3 rotation;
uniform vec3 eye;
uniform vec2 focal;
uniform vec2 principal;
uniform vec2 size;
uniform float near;
uniform vec2 scale_log;
layout(location = 0) in uint index;
out vec2 offset;
out vec4 color;

const float LOW_PASS = 0.3;

float signed_byte(uint byte) {
  int value = int(byte & 255u);
  return float(value > 127 ? value - 256 : value) / 127.0;
}

void main() {
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
  uvec4 g = texelFetch(gaussians, ivec2(int(index % 1024u), int(index / 1024u)), 0);
  vec3 u = vec3(g.x & 65535u, g.x >> 16, g.y & 65535u) / 32767.5 - 1.0;
  vec3 mean = u / (1.0 - min(abs(u), vec3(0.9999)));
  vec3 p = rotation * (mean - eye);
  if (p.z < near) return;

  vec3 steps = vec3((g.y >> 16) & 255u, g.y >> 24, g.z & 255u) / 255.0;
  vec3 s = exp(mix(vec3(scale_log.x), vec3(scale_log.y), steps));
  vec3 q = vec3(signed_byte(g.z >> 8), signed_byte(g.z >> 16), signed_byte(g.z >> 24));
  float w = sqrt(max(0.0, 1.0 - dot(q, q)));
  mat3 axes = mat3(
    1.0 - 2.0 * (q.y * q.y + q.z * q.z), 2.0 * (q.x * q.y + w * q.z), 2.0 * (q.x * q.z - w * q.y),
    2.0 * (q.x * q.y - w * q.z), 1.0 - 2.0 * (q.x * q.x + q.z * q.z), 2.0 * (q.y * q.z + w * q.x),
    2.0 * (q.x * q.z + w * q.y), 2.0 * (q.y * q.z - w * q.x), 1.0 - 2.0 * (q.x * q.x + q.y * q.y));
  mat3 m = rotation * axes * mat3(s.x, 0.0, 0.0, 0.0, s.y, 0.0, 0.0, 0.0, s.z);

  // The projection's Jacobian, held within 1.3 of the field of view.
  vec2 limit = 0.65 * size / focal;
  vec2 t = clamp(p.xy / p.z, -limit, limit);
  vec3 du = focal.x / p.z * vec3(1.0, 0.0, -t.x) * m;
  vec3 dv = focal.y / p.z * vec3(0.0, 1.0, -t.y) * m;
  float a = dot(du, du) + LOW_PASS;
  float b = dot(du, dv);
  float c = dot(dv, dv) + LOW_PASS;

  float middle = 0.5 * (a + c);
  float reach = length(vec2(0.5 * (a - c), b));
  vec2 along = abs(b) < 1e-9 ? (a >= c ? vec2(1.0, 0.0) : vec2(0.0, 1.0))
                             : normalize(vec2(b, middle + reach - a));
  vec2 across = vec2(-along.y, along.x);
  color = vec4(g.w & 255u, (g.w >> 8) & 255u, (g.w >> 16) & 255u, g.w >> 24) / 255.0;
  // Beyond this many standard deviations alpha is below 1/255.
  float far = sqrt(max(0.0, 2.0 * log(255.0 * color.a)));
  offset = far * (2.0 * vec2(gl_VertexID & 1, gl_VertexID >> 1) - 1.0);
  vec2 pixels = principal + focal * p.xy / p.z
    + offset.x * sqrt(middle + reach) * along
    + offset.y * sqrt(max(middle - reach, LOW_PASS)) * across;
  gl_Position = vec4(2.0 * pixels / size * vec2(1.0, -1.0), 0.0, 1.0);
}
