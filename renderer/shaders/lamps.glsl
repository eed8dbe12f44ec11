uniform float lamp; // brightness of the first lamp

// Evaluates the material at all places of a point, as btf() does at one place.
vec3 btf_at(places at, vec3 v, vec3 l, float lit) {
#if PLACES
    vec3 sum = vec3(0.0);
    vec2 dx = place_dx, dy = place_dy;
#ifdef BTF_PREPARED
    btf_prepare(v, l, lit);
#endif
    for (int k = 0; k < at.n; k++) {
        if (k == at.mean)
            prepare_mean();
#ifdef BTF_PREPARED
        sum += at.share[k] * btf_texel(at.x[k]);
#else
        sum += at.share[k] * btf(at.x[k], v, l, lit);
#endif
    }
    place_dx = dx;
    place_dy = dy;
    return max(sum, vec3(0.0));
#else
    return btf(at.x[0], v, l, lit);
#endif
}

// Returns the radiance of a point p under the first lamp, the even sky and all further lamps. at
// are the places of the sample that p shows. lit is the share of the first lamp's light that
// arrives. In the shadow of all lamps, only the light of the sky remains: ambient / π · L_a (Wang
// et al. 2005 §4.2). NO_FIRST_LAMP is defined if the first lamp and the sky give no light.
vec3 shade(mat3 frame, places at, vec3 v, vec3 p, float lit) {
    ambient = AMBIENT != 0 ? ambient_light : 0.0;
    vec3 sum = vec3(0.0);
#ifndef NO_FIRST_LAMP
    sum = btf_at(at, v, frame * light, lit * lamp);
#endif
#if LAMPS
    ambient = 0.0;
    for (int k = 0; k < n_lamps; k++) {
        float shines;
        vec3 l = towards_lamp(k, p, shines);
        sum += lamp_colours[k] * btf_at(at, v, frame * l, shines * further_at(k, p));
    }
#endif
#ifdef NEAR_LAMPS
    // close to a near lamp, light grows without limit; half floats end at about 6.5e4
    sum = min(sum, vec3(6e4));
#endif
    return sum;
}
