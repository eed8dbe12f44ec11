#include "swing.h"

#include <lapacke.h>
#include <string.h>

#define RAD(deg)      ((deg) * (G_PI / 180))
#define MIN_APART_RAD RAD(1)

/* Rodrigues' formula: v cos β + (a × v) sin β + a (a·v) (1 − cos β). */
struct vec3 rig_swing_direction(const struct rig_swing *swing, double angle_rad,
                                struct vec3 direction) {
    const struct vec3 a = swing->axis;
    const struct vec3 across = vec3_scale(vec3_cross(a, direction), sin(angle_rad));
    const struct vec3 along = vec3_scale(a, vec3_dot(a, direction) * (1 - cos(angle_rad)));

    return vec3_add(vec3_add(vec3_scale(direction, cos(angle_rad)), across), along);
}

struct vec3 rig_swing_point(const struct rig_swing *swing, double angle_rad, struct vec3 point_mm) {
    return vec3_add(swing->centre_mm,
                    rig_swing_direction(swing, angle_rad, vec3_sub(point_mm, swing->centre_mm)));
}

/* The rows of R are the camera's axes in the rig frame, which turn with the camera. */
void rig_swing_camera(const struct rig_swing *swing, double angle_rad, struct rig_camera *camera) {
    const struct vec3 centre = rig_swing_point(swing, angle_rad, rig_camera_centre_mm(camera));

    for (int i = 0; i < 3; i++) {
        double *row = camera->rotation.m[i];
        const struct vec3 turned =
            rig_swing_direction(swing, angle_rad, vec3(row[0], row[1], row[2]));
        row[0] = turned.x;
        row[1] = turned.y;
        row[2] = turned.z;
    }
    camera->translation_mm = vec3_scale(mat3_mul_vec(&camera->rotation, centre), -1);
}

/* Returns S v, where S = R_kᵀ R_j is the rotation of a camera from stop j to stop k (swing.h). */
static struct vec3 turned(const struct rig_camera *j, const struct rig_camera *k, struct vec3 v) {
    return mat3_mul_transposed(&k->rotation, mat3_mul_vec(&j->rotation, v));
}

/* Returns the rotation vector of S = R_kᵀ R_j (swing.h). */
static struct vec3 rotation_vector(const struct rig_camera *j, const struct rig_camera *k) {
    const struct vec3 x = turned(j, k, vec3(1, 0, 0)), y = turned(j, k, vec3(0, 1, 0)),
                      z = turned(j, k, vec3(0, 0, 1));
    const struct vec3 twice = vec3(y.z - z.y, z.x - x.z, x.y - y.x); /* 2 a sin β */
    const double sine = vec3_length(twice) / 2, cosine = (x.x + y.y + z.z - 1) / 2;

    return sine < 1e-12 ? vec3(0, 0, 0) : vec3_scale(twice, atan2(sine, cosine) / (2 * sine));
}

/* Finds the next pair of known stops j and k of one camera that are at least MIN_APART_RAD
 * apart. *j and *k hold the previous pair, or 0 and 0 at the start. Returns FALSE if none is
 * left. */
static gboolean next_pair(const struct rig *rig, struct camera_set known, int *j, int *k) {
    for (;;) {
        if (++*k >= rig->n_cameras) {
            ++*j;
            *k = *j;
            if (*j >= rig->n_cameras)
                return FALSE;
            continue;
        }
        const struct rig_camera *a = &rig->cameras[*j], *b = &rig->cameras[*k];
        if (a->on_arm && b->on_arm && rig_camera_unit(rig, *j) == rig_camera_unit(rig, *k) &&
            camera_set_has(known, *j) && camera_set_has(known, *k) &&
            fabs(RAD(b->arm_deg - a->arm_deg)) >= MIN_APART_RAD)
            return TRUE;
    }
}

/* Solves Σ (I − S)ᵀ (I − S) c = Σ (I − S)ᵀ (C_k − S C_j) for c, with the symbols of swing.h. The
 * condition a aᵀ c = 0 is added, because c may be any point of the axis. Returns FALSE if the
 * equations are singular. */
static gboolean fit_centre(const struct rig *rig, struct camera_set known,
                           struct rig_swing *swing) {
    const struct vec3 units[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const double a[3] = {swing->axis.x, swing->axis.y, swing->axis.z};
    double m[3][3], right[3] = {0};

    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            m[r][c] = a[r] * a[c];
    for (int j = 0, k = 0; next_pair(rig, known, &j, &k);) {
        const struct rig_camera *from = &rig->cameras[j], *to = &rig->cameras[k];
        const struct vec3 d =
            vec3_sub(rig_camera_centre_mm(to), turned(from, to, rig_camera_centre_mm(from)));
        struct vec3 column[3]; /* columns of I − S */
        for (int i = 0; i < 3; i++)
            column[i] = vec3_sub(units[i], turned(from, to, units[i]));
        for (int r = 0; r < 3; r++) {
            for (int c = 0; c < 3; c++)
                m[r][c] += vec3_dot(column[r], column[c]);
            right[r] += vec3_dot(column[r], d);
        }
    }
    if (LAPACKE_dposv(LAPACK_ROW_MAJOR, 'U', 3, 1, &m[0][0], 3, right, 1) != 0)
        return FALSE;
    swing->centre_mm = vec3(right[0], right[1], right[2]);
    return TRUE;
}

/* Returns the mean angle about the axis from the nominal centre of each known camera of the arm
 * to its calibrated centre. Returns 0 if the arm has no known camera. */
static double mean_zero_rad(const struct rig *rig, struct camera_set known,
                            const struct rig *nominal, const struct rig_swing *swing) {
    double sum = 0;
    int n = 0;

    for (int c = 0; c < rig->n_cameras; c++) {
        if (!rig->cameras[c].on_arm || !camera_set_has(known, c))
            continue;
        struct vec3 at = vec3_sub(rig_camera_centre_mm(&rig->cameras[c]), swing->centre_mm);
        struct vec3 meant =
            vec3_sub(rig_camera_centre_mm(&nominal->cameras[c]), nominal->arm.centre_mm);
        at = vec3_sub(at, vec3_scale(swing->axis, vec3_dot(at, swing->axis)));
        meant = vec3_sub(meant, vec3_scale(swing->axis, vec3_dot(meant, swing->axis)));
        sum += atan2(vec3_dot(vec3_cross(meant, at), swing->axis), vec3_dot(meant, at));
        n++;
    }
    return n ? sum / n : 0;
}

gboolean rig_swing_fit(const struct rig *rig, struct camera_set known, const struct rig *nominal,
                       struct rig_swing_fit *ret) {
    struct vec3 sum = vec3(0, 0, 0);
    double angles = 0, positions = 0;

    *ret = (struct rig_swing_fit){0};
    for (int j = 0, k = 0; next_pair(rig, known, &j, &k); ret->n_pairs++) {
        const struct vec3 turn = rotation_vector(&rig->cameras[j], &rig->cameras[k]);
        const double sign = rig->cameras[k].arm_deg > rig->cameras[j].arm_deg ? 1 : -1;
        sum = vec3_add(sum, vec3_scale(turn, sign));
    }
    if (ret->n_pairs == 0 || !(vec3_length(sum) > 0))
        return FALSE;
    ret->swing.axis = vec3_unit(sum);
    if (!fit_centre(rig, known, &ret->swing))
        return FALSE;
    for (int j = 0, k = 0; next_pair(rig, known, &j, &k);) {
        struct rig_camera moved = rig->cameras[j];
        const struct rig_camera *to = &rig->cameras[k];
        rig_swing_camera(&ret->swing, RAD(to->arm_deg - moved.arm_deg), &moved);
        const struct vec3 off = vec3_sub(rig_camera_centre_mm(&moved), rig_camera_centre_mm(to));
        const double angle = vec3_length(rotation_vector(&moved, to));
        angles += angle * angle;
        positions += vec3_dot(off, off);
    }
    ret->angle_rms_rad = sqrt(angles / ret->n_pairs);
    ret->position_rms_mm = sqrt(positions / ret->n_pairs);
    ret->zero_rad = mean_zero_rad(rig, known, nominal, &ret->swing);
    return TRUE;
}
