void main() {
    colour = vec4(btf(vec2(at.x, 1.0 - at.y), to_view, to_light, 1.0), 1.0);
}
