in vec2 at;
out vec4 colour;

void main() {
    float far = length((at - vec2(0.5, 0.55)) * vec2(1.0, 0.8));
    colour = vec4(vec3(mix(0.034, 0.009, smoothstep(0.0, 0.75, far))), 0.0);
}
