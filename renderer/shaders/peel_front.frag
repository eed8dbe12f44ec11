// Finds the nearest front faces of a layer behind which the ray meets the structure (Wang et al.
// 2005 fig. 7).
uniform sampler2D before; // back faces of the previous layer
uniform sampler2D back;   // back faces of this layer; 0 if the ray does not leave the mesh again

void main() {
    float z = distance_from_eye(), level = level_of_detail();
    vec2 end = texelFetch(back, ivec2(gl_FragCoord.xy), 0).rg;
    if (z <= texelFetch(before, ivec2(gl_FragCoord.xy), 0).r || (end.r > 0.0 && z >= end.r))
        discard;
    below ray = below_mesh(local_frame() * towards_eye(), level);
    float way = end.r > 0.0 ? end.r - z : 1e30;
    if (!meets(ray.hit, end.g, way))
        discard;
    colour = vec4(z, min(ray.hit, way), min(ray.base, way), 1.0);
}
