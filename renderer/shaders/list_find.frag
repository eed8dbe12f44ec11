// Finds the nearest front face behind which the ray meets the structure (Wang et al. 2005 §4.1), in
// a pixel's list of faces. The list ends at the face that sure_front.frag has found. Without lists,
// peel_back.frag and peel_front.frag find the same face layer by layer.
layout(r32ui, binding = 0) uniform uimage2D first;
uniform int layers;
out vec4 seen;

// Finds the nearest back face beyond z. Returns its distance from the eye, and the distance from
// this face back to the structure. The first value is 1e30 if there is no such face.
vec2 find_back(uint head, float z) {
    vec2 back = vec2(1e30, 0.0);
    for (uint at = head; at != 0u; at = faces[at - 1u].next) {
        face f = faces[at - 1u];
        if (f.hit < 0.0 && f.z > z && f.z < back.x)
            back = vec2(f.z, -f.hit);
    }
    return back;
}

vec4 find_front(uint head, float z, vec2 back) {
    vec4 found = vec4(1e30, 0.0, 0.0, 0.0);
    for (uint at = head; at != 0u; at = faces[at - 1u].next) {
        face f = faces[at - 1u];
        float way = back.x - f.z;
        if (f.hit > 0.0 && f.z > z && way > 0.0 && f.z < found.x && meets(f.hit, back.y, way))
            found = vec4(f.z, min(f.hit, way), min(f.base, way), 1.0);
    }
    return found;
}

void main() {
    uint head = imageLoad(first, ivec2(gl_FragCoord.xy)).r;
    float z = 0.0;
    for (int k = 0; head != 0u && k < layers && z < 1e30; k++) {
        vec2 back = find_back(head, z);
        vec4 front = find_front(head, z, back);
        if (front.w > 0.0) {
            seen = front;
            return;
        }
        z = back.x;
    }
    discard;
}
