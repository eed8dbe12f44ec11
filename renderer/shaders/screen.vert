// One triangle that covers the screen.
out vec2 at; // 0 … 1

void main() {
    at = vec2(float((gl_VertexID & 1) << 1), float(gl_VertexID & 2));
    gl_Position = vec4(2.0 * at - 1.0, 1.0, 1.0);
}
