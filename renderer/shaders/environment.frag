// Draws a picture of all directions as the background. Its first row is the zenith and its middle
// column is +x. φ decreases from left to right, as seen from inside.
uniform mat4 projection;
uniform vec3 eye;
uniform sampler2D environment; // radiance, as reflectance under a lamp of brightness 1
uniform float exposure;
uniform float turn; // rotation of the picture about the vertical axis, in radians

in vec2 at;
out vec4 colour;

const float PI = 3.14159265, MOST = 6e4; // MOST is close to the limit of half floats

void main() {
    vec4 far = inverse(projection) * vec4(2.0 * at - 1.0, 1.0, 1.0);
    vec3 ray = normalize(far.xyz / far.w - eye);
    float around = abs(ray.x) + abs(ray.y) > 0.0 ? atan(ray.y, ray.x) : 0.0;
    vec2 place = vec2(0.5 - (around - turn) / (2.0 * PI), acos(clamp(ray.z, -1.0, 1.0)) / PI);
    colour = vec4(min(textureLod(environment, place, 0.0).rgb * exposure, MOST), 0.0);
}
