// A plain weave. Warp and weft yarns cross each other, and their directions and colours alternate
// (Kang & Cho 2011 §IV.B). A yarn bends down at its sides, and where it passes under another yarn;
// see microfacet_view.c.
uniform vec3 diffuse, specular, weft_diffuse;
uniform vec2 rough;
// x: number of yarns per tile in each direction; y: slope across a yarn; z: slope along a yarn
uniform vec3 weave;

vec3 yarn(bool warp, vec3 n, vec3 v, vec3 l) {
    return facet(warp ? diffuse : weft_diffuse, specular, warp ? rough.yx : rough, n, v, l,
                 ROTATION);
}

// See method.h. If yarns are smaller than a pixel, the mean of warp and weft replaces them.
vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    vec2 place = x * weave.x, cell = floor(place), p = 2.0 * fract(place) - 1.0;
    vec2 wide = fwidth(place);
    float detail = 1.0 - smoothstep(0.5, 1.5, max(wide.x, wide.y));
    bool warp = mod(cell.x + cell.y, 2.0) < 0.5;
    p.y = -p.y;
    vec3 n = normalize(vec3(p * (warp ? weave.yz : weave.zy), 1.0));
    lit *= step(0.0, l.z);
    vec3 shown = detail > 0.0 ? detail * yarn(warp, n, v, l) : vec3(0.0);
    vec3 up = vec3(0.0, 0.0, 1.0);
    if (detail < 1.0)
        shown += (1.0 - detail) * 0.5 * (yarn(true, up, v, l) + yarn(false, up, v, l));
    vec3 sky =
        specular + mix(0.5 * (diffuse + weft_diffuse), warp ? diffuse : weft_diffuse, detail);
    return lit * shown + ambient * sky;
}
