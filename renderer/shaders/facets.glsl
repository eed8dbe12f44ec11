// Ward's or Ashikhmin and Shirley's model, with the normal and the tangent that were fitted to the
// texel (Kang & Cho 2011). The azimuth of the tangent is the direction of U on the surface. Page 0
// has the diffuse colour and U. Page 1 has the specular colour and V. Page 2 has the normal, and
// page 3 has the tangent.
vec3 reflectance(ivec2 texel, int slice, vec3 v, vec3 l) {
    vec4 diffuse = page(texel, 0, 0), specular = page(texel, 0, 1);
    vec3 n = page(texel, 0, 2).xyz;
    vec2 t = page(texel, 0, 3).xy;
    t = length(t) > 1e-6 ? normalize(t) : vec2(1.0, 0.0);
    mat3 turned = transpose(mat3(vec3(t, 0.0), vec3(-t.y, t.x, 0.0), vec3(0.0, 0.0, 1.0)));
    return facet(diffuse.rgb, specular.rgb, vec2(diffuse.a, specular.a), turned * n, turned * v,
                 turned * l, ROTATION);
}
