/* Vectors and 3×3 matrices of doubles, by value. */
#pragma once

#include <math.h>

struct vec3 {
    double x, y, z;
};

struct mat3 {
    double m[3][3]; /* [row][column] */
};

static inline struct vec3 vec3(double x, double y, double z) {
    return (struct vec3){x, y, z};
}
static inline struct vec3 vec3_add(struct vec3 a, struct vec3 b) {
    return vec3(a.x + b.x, a.y + b.y, a.z + b.z);
}
static inline struct vec3 vec3_sub(struct vec3 a, struct vec3 b) {
    return vec3(a.x - b.x, a.y - b.y, a.z - b.z);
}
static inline struct vec3 vec3_scale(struct vec3 a, double s) {
    return vec3(a.x * s, a.y * s, a.z * s);
}
static inline double vec3_dot(struct vec3 a, struct vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline struct vec3 vec3_cross(struct vec3 a, struct vec3 b) {
    return vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static inline double vec3_length(struct vec3 a) {
    return sqrt(vec3_dot(a, a));
}
/* Returns a / |a|. The components are not finite if a is 0. */
static inline struct vec3 vec3_unit(struct vec3 a) {
    return vec3_scale(a, 1.0 / vec3_length(a));
}
static inline struct vec3 mat3_mul_vec(const struct mat3 *a, struct vec3 v) {
    return vec3(a->m[0][0] * v.x + a->m[0][1] * v.y + a->m[0][2] * v.z,
                a->m[1][0] * v.x + a->m[1][1] * v.y + a->m[1][2] * v.z,
                a->m[2][0] * v.x + a->m[2][1] * v.y + a->m[2][2] * v.z);
}
/* Returns Aᵀ v. */
static inline struct vec3 mat3_mul_transposed(const struct mat3 *a, struct vec3 v) {
    return vec3(a->m[0][0] * v.x + a->m[1][0] * v.y + a->m[2][0] * v.z,
                a->m[0][1] * v.x + a->m[1][1] * v.y + a->m[2][1] * v.z,
                a->m[0][2] * v.x + a->m[1][2] * v.y + a->m[2][2] * v.z);
}
