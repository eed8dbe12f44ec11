/* Vectors of three floats, the element type of meshes. */
#pragma once

static inline float float3_dot(const float a[3], const float b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void float3_cross(const float a[3], const float b[3], float ret[3]) {
    for (int k = 0; k < 3; k++)
        ret[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

/* Computes a − b. */
static inline void float3_minus(const float a[3], const float b[3], float ret[3]) {
    for (int k = 0; k < 3; k++)
        ret[k] = a[k] - b[k];
}
