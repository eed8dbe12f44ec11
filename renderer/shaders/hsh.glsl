// Hemispherical harmonics of the light (Gautron et al. 2004), in the order and with the signs of
// hsh.h. N_TERMS (4, 9 or 16) is a constant. For the pages of a slice, see hsh_view.c.
const float PI_INVERSE = 0.3183098861837907;

// Computes H_0 … H_15. Callers use only the first N_TERMS.
void hsh_basis(vec3 l, out float h[16]) {
    float c = clamp(l.z, 0.0, 1.0), w = c - c * c, x = 2.0 * c - 1.0;
    vec2 p = sqrt(c / (1.0 + c)) * l.xy; // sqrt(w) (cos phi, sin phi)
    float cos2 = p.x * p.x - p.y * p.y, sin2 = 2.0 * p.x * p.y;
    h[0] = sqrt(0.5 * PI_INVERSE);
    h[1] = sqrt(6.0 * PI_INVERSE) * p.x;
    h[2] = sqrt(1.5 * PI_INVERSE) * x;
    h[3] = sqrt(6.0 * PI_INVERSE) * p.y;
    h[4] = -sqrt(30.0 * PI_INVERSE) * cos2;
    h[5] = sqrt(30.0 * PI_INVERSE) * x * p.x;
    h[6] = sqrt(2.5 * PI_INVERSE) * (1.0 - 6.0 * w);
    h[7] = sqrt(30.0 * PI_INVERSE) * x * p.y;
    h[8] = -sqrt(30.0 * PI_INVERSE) * sin2;
    h[9] = 2.0 * sqrt(35.0 * PI_INVERSE) * p.x * (p.x * p.x - 3.0 * p.y * p.y);
    h[10] = -sqrt(210.0 * PI_INVERSE) * x * cos2;
    h[11] = 2.0 * sqrt(21.0 * PI_INVERSE) * p.x * (1.0 - 5.0 * w);
    h[12] = sqrt(3.5 * PI_INVERSE) * x * (1.0 - 10.0 * w);
    h[13] = 2.0 * sqrt(21.0 * PI_INVERSE) * p.y * (1.0 - 5.0 * w);
    h[14] = -sqrt(210.0 * PI_INVERSE) * x * sin2;
    h[15] = 2.0 * sqrt(35.0 * PI_INVERSE) * p.y * (3.0 * p.x * p.x - p.y * p.y);
}

vec3 reflectance(ivec2 texel, int slice, vec3 v, vec3 l) {
    float h[16];
    hsh_basis(l, h);
    vec3 sum = vec3(0.0);
    for (int k = 0; k < N_TERMS / 4; k++) {
        vec4 four = vec4(h[4 * k], h[4 * k + 1], h[4 * k + 2], h[4 * k + 3]);
        for (int c = 0; c < 3; c++)
            sum[c] += dot(page(texel, slice, 3 * k + c), four);
    }
    for (int k = N_TERMS / 4 * 4; k < N_TERMS; k++)
        sum += page(texel, slice, 3 * (N_TERMS / 4) + k - N_TERMS / 4 * 4).rgb * h[k];
    return sum;
}
