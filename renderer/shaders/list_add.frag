layout(early_fragment_tests) in;
layout(r32ui, binding = 0) uniform uimage2D first;
uniform uint room; // number of faces for which the buffer has space

// Adds the face to the list of its pixel.
void main() {
    bool front = gl_FrontFacing;
    below ray =
        below_mesh(local_frame() * (front ? towards_eye() : -towards_eye()), level_of_detail());
    uint at = atomicAdd(n_faces, 1u);
    if (at >= room)
        return;
    uint next = imageAtomicExchange(first, ivec2(gl_FragCoord.xy), at + 1u);
    float hit = max(ray.hit, 1e-9);
    faces[at] = face(next, distance_from_eye(), front ? hit : -hit, ray.base);
}
