// The ray from the eye, or from a lamp, to a point of the mesh.
uniform vec4 sight; // w = 1: position of the eye; w = 0: unit vector towards a distant eye
uniform float
    reach; // for w = 0: distance from the origin to the plane from which distances are measured

vec3 towards_eye() {
    return sight.w > 0.5 ? normalize(sight.xyz - world) : sight.xyz;
}

float distance_from_eye() {
    return sight.w > 0.5 ? length(sight.xyz - world) : reach - dot(sight.xyz, world);
}
