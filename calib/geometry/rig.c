/* This file has the models of camera, arc, lamp and laser. Vectors are columns. A rotation matrix R
 * maps rig to camera coordinates, and Rᵀ maps a viewing ray back. */
#include "rig.h"

#include <string.h>

#define INVERSE_STEPS        60
#define SAMPLED_RADII        16 /* number of radii at which a lens is checked for folding back */
#define INVERSE_TOLERANCE_PX 1e-11

static const struct vec3 up = {0, 0, 1};

/* Returns whether the rig has this swing. Most rigs have none, and need no search of their cameras
 * or lamps. */
static gboolean is_there(const struct rig_swing *swing) {
    return swing->axis.x != 0 || swing->axis.y != 0 || swing->axis.z != 0;
}

double rig_arm_deg(const struct rig *rig, struct camera_set cameras) {
    int first = -1;

    if (!is_there(&rig->arm))
        return 0;
    for (int c = 0; c < rig->n_cameras; c++) {
        if (!rig->cameras[c].on_arm)
            continue;
        if (camera_set_has(cameras, c))
            return rig->cameras[c].arm_deg;
        first = first < 0 ? c : first;
    }
    return first < 0 ? 0 : rig->cameras[first].arm_deg;
}

double rig_probe_deg(const struct rig *rig, int lamp) {
    if (!is_there(&rig->probe))
        return 0;
    if (lamp >= 0 && rig->lamps[lamp].on_probe)
        return rig->lamps[lamp].probe_deg;
    for (int i = 0; i < rig->n_lamps; i++)
        if (rig->lamps[i].on_probe)
            return rig->lamps[i].probe_deg;
    return 0;
}

void rig_stop_device(const char *name, int is_carried, char ret[RIG_NAME]) {
    char *at;

    g_strlcpy(ret, name, RIG_NAME);
    if (is_carried && (at = strrchr(ret, '@')))
        *at = 0;
}

void rig_camera_look_at(struct rig_camera *camera, struct vec3 eye_mm, struct vec3 target_mm) {
    struct vec3 forward = vec3_unit(vec3_sub(target_mm, eye_mm));
    struct vec3 right = vec3_cross(forward, up);

    /* For a camera that looks straight up or down, the cross product is 0. The right vector of this
     * camera is then that of a camera at azimuth 0. */
    right = vec3_length(right) > 1e-9 ? vec3_unit(right) : vec3(0, 1, 0);
    struct vec3 down = vec3_cross(forward, right);
    camera->rotation = (struct mat3){
        {{right.x, right.y, right.z}, {down.x, down.y, down.z}, {forward.x, forward.y, forward.z}}};
    camera->translation_mm = vec3_scale(mat3_mul_vec(&camera->rotation, eye_mm), -1);
}

struct vec3 rig_camera_centre_mm(const struct rig_camera *camera) {
    return vec3_scale(mat3_mul_transposed(&camera->rotation, camera->translation_mm), -1);
}

/* x_px = fx x'' + cx: a larger focal length magnifies about the principal point. */
struct rig_camera rig_camera_of_colour(const struct rig_camera *camera, int colour) {
    struct rig_camera ret = *camera;
    ret.fx_px *= 1 + camera->lateral_colour[colour];
    ret.fy_px *= 1 + camera->lateral_colour[colour];
    return ret;
}

const char *rig_lens_name(enum rig_lens lens) {
    static const char *const names[RIG_LENSES] = {"polynomial", "rational", "fisheye"};
    return names[lens];
}

gboolean rig_lens_by_name(const char *name, enum rig_lens *ret) {
    for (int i = 0; i < RIG_LENSES; i++)
        if (g_str_equal(name, rig_lens_name((enum rig_lens)i))) {
            *ret = (enum rig_lens)i;
            return TRUE;
        }
    return FALSE;
}

/* Returns the radial factor g(s) of the polynomial and rational lens for s = r², and its
 * derivative. */
static double radial(const struct rig_camera *c, double s, double *ret_slope) {
    const double above = 1 + s * (c->k1 + s * (c->k2 + s * c->k3));
    const double slope = c->k1 + s * (2 * c->k2 + s * 3 * c->k3);

    *ret_slope = slope;
    if (c->lens != RIG_LENS_RATIONAL)
        return above;
    const double below = 1 + s * (c->k4 + s * (c->k5 + s * c->k6));
    const double slope_below = c->k4 + s * (2 * c->k5 + s * 3 * c->k6);
    *ret_slope = (slope * below - above * slope_below) / (below * below);
    return above / below;
}

/* Computes x'' = x' g(r²) + 2 p1 x'y' + p2 (r² + 2x'²), y'' in the same way, and the Jacobian
 * {∂x''/∂x', ∂x''/∂y', ∂y''/∂x', ∂y''/∂y'}. */
static void distort(const struct rig_camera *c, double x, double y, double *ret_x, double *ret_y,
                    double j[4]) {
    double s = x * x + y * y, slope, g = radial(c, s, &slope);

    *ret_x = x * g + 2 * c->p1 * x * y + c->p2 * (s + 2 * x * x);
    *ret_y = y * g + c->p1 * (s + 2 * y * y) + 2 * c->p2 * x * y;
    j[0] = g + 2 * slope * x * x + 2 * c->p1 * y + 6 * c->p2 * x;
    j[1] = 2 * slope * x * y + 2 * c->p1 * x + 2 * c->p2 * y;
    j[2] = j[1];
    j[3] = g + 2 * slope * y * y + 6 * c->p1 * y + 2 * c->p2 * x;
}

/* Returns d(r'')/dr' = g + 2 s g'(s) without tangential distortion, for s = r'². */
static double radial_slope(const struct rig_camera *c, double s) {
    double slope, g = radial(c, s, &slope);
    return g + 2 * s * slope;
}

/* Returns whether the distorted radius grows all the way from the centre to s = r'². The slope of
 * the polynomial has its extremes where 3 k1 + 10 k2 s + 21 k3 s² = 0. The slope of the rational
 * lens is sampled, and its denominator must not vanish. */
static gboolean radius_grows(const struct rig_camera *c, double s) {
    double a = 21 * c->k3, b = 10 * c->k2, d = 3 * c->k1;
    double roots[2] = {-1, -1};

    for (int i = 1; c->lens == RIG_LENS_RATIONAL && i < SAMPLED_RADII; i++) {
        const double at = s * i * i / (SAMPLED_RADII * SAMPLED_RADII);
        if (!(1 + at * (c->k4 + at * (c->k5 + at * c->k6)) > 0) || !(radial_slope(c, at) > 0))
            return FALSE;
    }
    if (c->lens == RIG_LENS_RATIONAL)
        return 1 + s * (c->k4 + s * (c->k5 + s * c->k6)) > 0 && radial_slope(c, s) > 0;
    if (a != 0 && b * b - 4 * a * d >= 0) {
        double q = -0.5 * (b + copysign(sqrt(b * b - 4 * a * d), b));
        roots[0] = q / a;
        roots[1] = q != 0 ? d / q : -1;
    } else if (a == 0 && b != 0) {
        roots[0] = -d / b;
    }
    for (int i = 0; i < 2; i++)
        if (roots[i] > 0 && roots[i] < s && radial_slope(c, roots[i]) <= 0)
            return FALSE;
    return radial_slope(c, s) > 0;
}

/* Returns the radius of a fisheye, ρ(θ) = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), and dρ/dθ. */
static double fisheye_radius(const struct rig_camera *c, double theta, double *ret_slope) {
    const double s = theta * theta;
    *ret_slope = 1 + s * (3 * c->k1 + s * (5 * c->k2 + s * (7 * c->k3 + s * 9 * c->k4)));
    return theta * (1 + s * (c->k1 + s * (c->k2 + s * (c->k3 + s * c->k4))));
}

/* Returns whether ρ grows all the way to θ. Its slope is sampled. */
static gboolean fisheye_grows(const struct rig_camera *c, double theta) {
    double slope;
    for (int i = 1; i <= SAMPLED_RADII; i++) {
        fisheye_radius(c, theta * i / SAMPLED_RADII, &slope);
        if (!(slope > 0))
            return FALSE;
    }
    return TRUE;
}

/* Inverts ρ(θ). Finds the two samples between which ρ(θ) first reaches the radius, for θ in [0, π],
 * and then bisects. */
static double fisheye_angle(const struct rig_camera *c, double radius) {
    const double step = G_PI / 256;
    double low = 0, slope;

    while (low < G_PI && fisheye_radius(c, low + step, &slope) < radius) {
        if (slope <= 0)
            break; /* the lens folds back, so no ray has that radius */
        low += step;
    }
    double high = MIN(low + step, G_PI);
    for (int i = 0; i < INVERSE_STEPS && high - low > 0; i++) {
        const double middle = (low + high) / 2, r = fisheye_radius(c, middle, &slope);
        if (r < radius && slope > 0)
            low = middle;
        else
            high = middle;
    }
    return (low + high) / 2;
}

/* Applies p' = R p + t, then the lens, then the camera matrix. Returns FALSE for a point behind the
 * camera (for a fisheye: exactly at the camera's centre or straight behind it). Also returns FALSE
 * where the lens model is not invertible: the radius stops growing, or the Jacobian's determinant
 * is not positive. */
gboolean rig_project(const struct rig_camera *camera, struct vec3 point_mm, double *ret_x_px,
                     double *ret_y_px) {
    struct vec3 p = vec3_add(mat3_mul_vec(&camera->rotation, point_mm), camera->translation_mm);
    double x, y, j[4];

    if (camera->lens == RIG_LENS_FISHEYE) {
        const double across = hypot(p.x, p.y), theta = atan2(across, p.z);
        if (!(across > 0 || p.z > 0) || !fisheye_grows(camera, theta))
            return FALSE;
        const double radius = fisheye_radius(camera, theta, &j[0]);
        x = across > 0 ? p.x / across * radius : 0;
        y = across > 0 ? p.y / across * radius : 0;
    } else {
        if (!(p.z > 0))
            return FALSE;
        x = p.x / p.z;
        y = p.y / p.z;
        if (!radius_grows(camera, x * x + y * y))
            return FALSE;
        distort(camera, x, y, &x, &y, j);
        if (!(j[0] * j[3] - j[1] * j[2] > 0))
            return FALSE;
    }
    *ret_x_px = camera->fx_px * x + camera->cx_px;
    *ret_y_px = camera->fy_px * y + camera->cy_px;
    return TRUE;
}

/* Inverts distort() by Newton's method, starting at the distorted point. A step is halved while it
 * increases the error. */
static void undistort(const struct rig_camera *c, double xd, double yd, double *x, double *y) {
    double scale = MAX(c->fx_px, c->fy_px), fx, fy, j[4], next[4];

    *x = xd;
    *y = yd;
    distort(c, *x, *y, &fx, &fy, j);
    double error_left = hypot(fx - xd, fy - yd);
    for (int i = 0; i < INVERSE_STEPS && error_left * scale > INVERSE_TOLERANCE_PX; i++) {
        double det = j[0] * j[3] - j[1] * j[2];
        if (det == 0)
            return;
        double dx = (j[3] * (fx - xd) - j[1] * (fy - yd)) / det;
        double dy = (j[0] * (fy - yd) - j[2] * (fx - xd)) / det;
        for (double step = 1;; step /= 2) {
            double nx, ny;
            distort(c, *x - step * dx, *y - step * dy, &nx, &ny, next);
            double error = hypot(nx - xd, ny - yd);
            if (error < error_left) {
                *x -= step * dx;
                *y -= step * dy;
                fx = nx, fy = ny, error_left = error;
                memcpy(j, next, sizeof next);
                break;
            }
            if (step < 1e-6)
                return;
        }
    }
}

struct vec3 rig_pixel_ray(const struct rig_camera *camera, double x_px, double y_px) {
    const double xd = (x_px - camera->cx_px) / camera->fx_px;
    const double yd = (y_px - camera->cy_px) / camera->fy_px, radius = hypot(xd, yd);
    double x, y;

    if (camera->lens == RIG_LENS_FISHEYE && radius > 0) {
        const double theta = fisheye_angle(camera, radius), across = sin(theta) / radius;
        return vec3_unit(
            mat3_mul_transposed(&camera->rotation, vec3(xd * across, yd * across, cos(theta))));
    }
    undistort(camera, xd, yd, &x, &y);
    return vec3_unit(mat3_mul_transposed(&camera->rotation, vec3(x, y, 1)));
}

struct rig_rotation rig_rotation(double angle_rad) {
    return (struct rig_rotation){cos(angle_rad), sin(angle_rad)};
}

struct vec3 rig_turn(struct vec3 v, double angle_rad) {
    return rig_rotate(rig_rotation(angle_rad), v);
}

static struct rig_tilt tilt_of(const double t[2]) {
    const double angle = hypot(t[0], t[1]);
    if (angle == 0)
        return (struct rig_tilt){.cosine = 1};
    return (struct rig_tilt){vec3(t[0] / angle, t[1] / angle, 0), cos(angle), sin(angle)};
}

/* Rodrigues' formula: v cos θ + sign (k × v) sin θ + k (k·v)(1 − cos θ), with the angle θ and the
 * axis k of the tilt. */
static struct vec3 tilt(const struct rig_tilt *by, struct vec3 v, double sign) {
    const struct vec3 k = by->axis;
    if (by->sine == 0)
        return v;
    struct vec3 across = vec3_scale(vec3_cross(k, v), sign * by->sine);
    struct vec3 along = vec3_scale(k, vec3_dot(k, v) * (1 - by->cosine));
    return vec3_add(vec3_add(vec3_scale(v, by->cosine), across), along);
}

/* The rotation vector is t = (tx, ty, 0). */
struct vec3 rig_tilt_point(const double t[2], struct vec3 v, double sign) {
    const struct rig_tilt by = tilt_of(t);
    return tilt(&by, v, sign);
}

void rig_wobble_tilt(const struct rig_wobble *wobble, double turntable_rad, double ret_rad[2]) {
    ret_rad[0] = ret_rad[1] = 0;
    for (int k = 0; k < RIG_WOBBLE_HARMONICS; k++) {
        const double *of = wobble->rad[k];
        const double c = cos((k + 1) * turntable_rad), s = sin((k + 1) * turntable_rad);
        ret_rad[0] += of[0] * c + of[1] * s;
        ret_rad[1] += of[2] * c + of[3] * s;
    }
}

double rig_wobble_most_rad(const struct rig_wobble *wobble) {
    double most = 0, tilt_rad[2];
    for (int deg = 0; deg < 360; deg++) {
        rig_wobble_tilt(wobble, deg * (G_PI / 180), tilt_rad);
        most = MAX(most, hypot(tilt_rad[0], tilt_rad[1]));
    }
    return most;
}

/* Rotates everything that does not turn with the sample by −t. For a camera, R Wᵀ replaces R, so
 * each row of its rotation is rotated like a point. */
static void tilt_back(struct rig *rig, const double t[2]) {
    if (t[0] == 0 && t[1] == 0)
        return;
    for (int i = 0; i < rig->n_cameras; i++)
        for (int row = 0; row < 3; row++) {
            double *of = rig->cameras[i].rotation.m[row];
            const struct vec3 v = rig_tilt_point(t, vec3(of[0], of[1], of[2]), -1);
            of[0] = v.x;
            of[1] = v.y;
            of[2] = v.z;
        }
    rig->arc.tilt_rad[0] -= t[0];
    rig->arc.tilt_rad[1] -= t[1];
    for (int i = 0; i < rig->n_lamps; i++) {
        struct rig_lamp *lamp = &rig->lamps[i];
        if (!lamp->fixed)
            continue;
        lamp->position_mm = rig_tilt_point(t, lamp->position_mm, -1);
        lamp->aim = rig_tilt_point(t, lamp->aim, -1);
    }
    for (int i = 0; i < rig->n_lasers; i++) {
        struct rig_laser *laser = &rig->lasers[i];
        if (!laser->fixed)
            continue;
        laser->position_mm = rig_tilt_point(t, laser->position_mm, -1);
        laser->axis = rig_tilt_point(t, laser->axis, -1);
        laser->normal = rig_tilt_point(t, laser->normal, -1);
    }
    struct rig_swing *const swings[] = {&rig->arm, &rig->probe};
    for (gsize i = 0; i < G_N_ELEMENTS(swings); i++) {
        swings[i]->axis = rig_tilt_point(t, swings[i]->axis, -1);
        swings[i]->centre_mm = rig_tilt_point(t, swings[i]->centre_mm, -1);
    }
}

void rig_at(const struct rig *rig, double turntable_rad, struct rig *ret) {
    double t[2];
    rig_wobble_tilt(&rig->wobble, turntable_rad, t);
    if (ret != rig)
        *ret = *rig;
    tilt_back(ret, t);
}

struct vec3 rig_sample_point(const struct rig *rig, double turntable_rad, struct vec3 point_mm) {
    double t[2];
    rig_wobble_tilt(&rig->wobble, turntable_rad, t);
    return rig_tilt_point(t, rig_turn(point_mm, turntable_rad), 1);
}

static struct rig_arc_pose arc_pose(const struct rig_arc *arc, double arc_rad) {
    if (!arc)
        return (struct rig_arc_pose){.turn = rig_rotation(arc_rad), .tilt = {.cosine = 1}};
    return (struct rig_arc_pose){rig_rotation(arc_rad + arc->zero_rad), tilt_of(arc->tilt_rad),
                                 vec3(arc->centre_mm[0], arc->centre_mm[1], 0)};
}

/* The pose of a device that does not move with the arc. */
static struct rig_arc_pose device_pose(const struct rig_arc *arc, gboolean fixed, double arc_rad) {
    return fixed ? (struct rig_arc_pose){{1, 0}, {.cosine = 1}, {0, 0, 0}} : arc_pose(arc, arc_rad);
}

/* Returns tilt · Rz(α + zero) · d. */
static struct vec3 pose_direction(const struct rig_arc_pose *pose, struct vec3 direction) {
    return tilt(&pose->tilt, rig_rotate(pose->turn, direction), 1);
}

/* Returns tilt · Rz(α + zero) · p + centre. */
static struct vec3 pose_point(const struct rig_arc_pose *pose, struct vec3 point_mm) {
    return vec3_add(pose_direction(pose, point_mm), pose->centre_mm);
}

static struct vec3 pose_point_back(const struct rig_arc_pose *pose, struct vec3 point_mm) {
    const struct vec3 p = tilt(&pose->tilt, vec3_sub(point_mm, pose->centre_mm), -1);
    return rig_rotate((struct rig_rotation){pose->turn.cosine, -pose->turn.sine}, p);
}

struct vec3 rig_arc_direction(const struct rig_arc *arc, double arc_rad, struct vec3 direction) {
    const struct rig_arc_pose pose = arc_pose(arc, arc_rad);
    return pose_direction(&pose, direction);
}

struct vec3 rig_arc_point(const struct rig_arc *arc, double arc_rad, struct vec3 point_mm) {
    const struct rig_arc_pose pose = arc_pose(arc, arc_rad);
    return pose_point(&pose, point_mm);
}

struct vec3 rig_arc_point_back(const struct rig_arc *arc, double arc_rad, struct vec3 point_mm) {
    const struct rig_arc_pose pose = arc_pose(arc, arc_rad);
    return pose_point_back(&pose, point_mm);
}

/* The next three functions convert from the frame of the arc to the rig frame, and back. A fixed
 * device is in the rig frame already. */
static struct vec3 carried_point(const struct rig_arc *arc, gboolean fixed, double arc_rad,
                                 struct vec3 point_mm) {
    return fixed ? point_mm : rig_arc_point(arc, arc_rad, point_mm);
}

static struct vec3 carried_direction(const struct rig_arc *arc, gboolean fixed, double arc_rad,
                                     struct vec3 direction) {
    return fixed ? direction : rig_arc_direction(arc, arc_rad, direction);
}

static struct vec3 carried_point_back(const struct rig_arc *arc, gboolean fixed, double arc_rad,
                                      struct vec3 point_mm) {
    return fixed ? point_mm : rig_arc_point_back(arc, arc_rad, point_mm);
}

struct vec3 rig_lamp_position_mm(const struct rig_arc *arc, const struct rig_lamp *lamp,
                                 double arc_rad) {
    return carried_point(arc, lamp->fixed, arc_rad, lamp->position_mm);
}

struct vec3 rig_lamp_aim(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad) {
    return carried_direction(arc, lamp->fixed, arc_rad, lamp->aim);
}

struct vec3 rig_lamp_point_back(const struct rig_arc *arc, const struct rig_lamp *lamp,
                                double arc_rad, struct vec3 point_mm) {
    return carried_point_back(arc, lamp->fixed, arc_rad, point_mm);
}

/* Returns E = intensity · cosⁿ(angle from the aim) / r², with r in metres. */
double rig_lamp_irradiance(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad,
                           struct vec3 point_mm) {
    struct vec3 path = vec3_sub(point_mm, rig_lamp_position_mm(arc, lamp, arc_rad));
    double r_mm = vec3_length(path);
    double cosine = vec3_dot(path, rig_lamp_aim(arc, lamp, arc_rad)) / r_mm;

    if (cosine <= 0)
        return 0;
    return lamp->intensity * pow(cosine, lamp->exponent) / (r_mm * r_mm * 1e-6);
}

struct vec3 rig_laser_position_mm(const struct rig_arc *arc, const struct rig_laser *laser,
                                  double arc_rad) {
    return carried_point(arc, laser->fixed, arc_rad, laser->position_mm);
}

struct vec3 rig_laser_axis(const struct rig_arc *arc, const struct rig_laser *laser,
                           double arc_rad) {
    return carried_direction(arc, laser->fixed, arc_rad, laser->axis);
}

struct rig_lamp rig_lamp_placed(const struct rig_arc *arc, const struct rig_lamp *lamp,
                                double arc_rad) {
    struct rig_lamp placed = *lamp;

    placed.position_mm = rig_lamp_position_mm(arc, lamp, arc_rad);
    placed.aim = rig_lamp_aim(arc, lamp, arc_rad);
    placed.fixed = TRUE;
    return placed;
}

struct rig_laser rig_laser_placed(const struct rig_arc *arc, const struct rig_laser *laser,
                                  double arc_rad) {
    struct rig_laser placed = *laser;

    placed.position_mm = rig_laser_position_mm(arc, laser, arc_rad);
    placed.axis = rig_laser_axis(arc, laser, arc_rad);
    placed.normal = carried_direction(arc, laser->fixed, arc_rad, laser->normal);
    placed.fixed = TRUE;
    return placed;
}

struct rig_laser_pose rig_laser_pose(const struct rig_arc *arc, const struct rig_laser *laser,
                                     double arc_rad) {
    struct rig_laser_pose pose = {.laser = laser,
                                  .arc = device_pose(arc, laser->fixed, arc_rad),
                                  .across = vec3_cross(laser->axis, laser->normal)};
    pose.position_mm = pose_point(&pose.arc, laser->position_mm);
    pose.axis = pose_direction(&pose.arc, laser->axis);
    pose.normal = pose_direction(&pose.arc, laser->normal);
    return pose;
}

/* The normal of the sheet at sweep angle s is n cos s' + (axis × n) sin s', with s' = s (1 +
 * stretch). This is Rodrigues' formula for a vector perpendicular to the axis. */
struct rig_plane rig_laser_pose_sheet(const struct rig_laser_pose *pose, double sweep_rad) {
    const double s = sweep_rad * (1 + pose->laser->stretch);
    const struct vec3 normal =
        vec3_add(vec3_scale(pose->laser->normal, cos(s)), vec3_scale(pose->across, sin(s)));
    struct rig_plane sheet = {.normal = pose_direction(&pose->arc, normal)};

    sheet.offset_mm = vec3_dot(sheet.normal, pose->position_mm);
    return sheet;
}

struct rig_plane rig_laser_sheet(const struct rig_arc *arc, const struct rig_laser *laser,
                                 double arc_rad, double sweep_rad) {
    const struct rig_laser_pose pose = rig_laser_pose(arc, laser, arc_rad);
    return rig_laser_pose_sheet(&pose, sweep_rad);
}

/* Returns the position of a point relative to the laser, in the frame of the laser's carrier. */
static struct vec3 way_to(const struct rig_laser_pose *pose, struct vec3 point_mm) {
    return vec3_sub(pose_point_back(&pose->arc, point_mm), pose->laser->position_mm);
}

/* Returns bend·t², with t² = a² / r², a = q·axis and r² = q·q − a², where q = way is the point
 * relative to the laser. */
static double bent_rad(const struct rig_laser *laser, struct vec3 way) {
    const double along = vec3_dot(way, laser->axis);
    const double away2 = vec3_dot(way, way) - along * along;

    return laser->bend_rad == 0 || !(away2 > 0) ? 0 : laser->bend_rad * along * along / away2;
}

double rig_laser_pose_bent_rad(const struct rig_laser_pose *pose, struct vec3 point_mm) {
    if (pose->laser->bend_rad == 0)
        return 0;
    return bent_rad(pose->laser, way_to(pose, point_mm)) / (1 + pose->laser->stretch);
}

double rig_laser_bent_rad(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                          struct vec3 point_mm) {
    const struct rig_laser_pose pose = rig_laser_pose(arc, laser, arc_rad);
    return rig_laser_pose_bent_rad(&pose, point_mm);
}

/* Returns s = (atan2(q·n, q·beam) − bend·t²) / (1 + stretch), where q is the point relative to the
 * laser in its carrier's frame, n the normal, and beam = n × axis. t does not depend on s. */
double rig_laser_pose_sweep_rad(const struct rig_laser_pose *pose, struct vec3 point_mm) {
    const struct rig_laser *laser = pose->laser;
    const struct vec3 way = way_to(pose, point_mm), beam = vec3_cross(laser->normal, laser->axis);
    /* atan2(), not atan(): only the half of the sheet on the beam's side of the axis is lit. */
    const double about = atan2(vec3_dot(way, laser->normal), vec3_dot(way, beam));

    return (about - bent_rad(laser, way)) / (1 + laser->stretch);
}

double rig_laser_sweep_rad(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                           struct vec3 point_mm) {
    const struct rig_laser_pose pose = rig_laser_pose(arc, laser, arc_rad);
    return rig_laser_pose_sweep_rad(&pose, point_mm);
}

/* The bend moves the sheet by bend·t² times the distance r from the axis, and t² r = a² / r. */
void rig_laser_pose_lever(const struct rig_laser_pose *pose, struct vec3 point_mm,
                          double ret[RIG_SHEET_PARAMETERS]) {
    const struct vec3 axis = pose->axis, normal = pose->normal;
    const struct vec3 way = vec3_sub(point_mm, pose->position_mm);
    const double along = vec3_dot(way, axis);

    ret[RIG_SHEET_OFFSET] = 1;
    ret[RIG_SHEET_ALONG] = vec3_dot(point_mm, axis);
    ret[RIG_SHEET_ACROSS] = vec3_dot(point_mm, normal);
    ret[RIG_SHEET_BEAM] = vec3_dot(point_mm, vec3_cross(normal, axis));
    ret[RIG_SHEET_BEND] = along * along / sqrt(MAX(vec3_dot(way, way) - along * along, 1e-12));
}

void rig_laser_sheet_lever(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                           struct vec3 point_mm, double ret[RIG_SHEET_PARAMETERS]) {
    const struct rig_laser_pose pose = rig_laser_pose(arc, laser, arc_rad);
    rig_laser_pose_lever(&pose, point_mm, ret);
}

double rig_laser_sheet_error_mm(const struct rig_arc *arc, const struct rig_laser *laser,
                                double arc_rad, const struct rig_sheet_errors *errors,
                                struct vec3 point_mm) {
    double lever[RIG_SHEET_PARAMETERS], variance = 0;

    rig_laser_sheet_lever(arc, laser, arc_rad, point_mm, lever);
    for (int i = 0; i < RIG_SHEET_PARAMETERS; i++)
        for (int k = 0; k < RIG_SHEET_PARAMETERS; k++)
            variance += lever[i] * errors->covariance[i][k] * lever[k];
    return sqrt(MAX(variance, 0));
}

/* Returns the distance between the arc and the line of sight at the arc's radius, minus half the
 * arc's width, and minus the radius of the cone of sight there. */
double rig_arc_clearance_mm(const struct rig *rig, int camera, double arc_rad, double radius_mm) {
    struct vec3 eye = rig_camera_centre_mm(&rig->cameras[camera]);
    double distance = vec3_length(eye), radius = rig->arc_radius_mm;

    if (radius == 0 || distance <= radius)
        return G_MAXDOUBLE; /* there is no arc, or it is behind the camera */
    struct vec3 towards = rig_turn(vec3_scale(eye, 1 / distance), -(arc_rad + rig->arc.zero_rad));
    double theta = towards.x > 0 ? atan2(towards.x, towards.z) : 0;

    double apart =
        radius * vec3_length(vec3_sub(towards, rig_direction(CLAMP(theta, 0, G_PI_2), 0)));
    double cone = radius_mm * (1 - radius / distance);

    return apart - rig->arc_width_mm / 2 - cone;
}

void rig_angles(struct vec3 direction, double *ret_theta_rad, double *ret_phi_rad) {
    double phi = atan2(direction.y, direction.x);

    if (phi < 0)
        phi += 2 * G_PI;
    if (phi >= 2 * G_PI) /* rounding can give a full turn */
        phi = 0;
    *ret_theta_rad = atan2(hypot(direction.x, direction.y), direction.z);
    *ret_phi_rad = phi;
}

struct vec3 rig_direction(double theta_rad, double phi_rad) {
    return vec3(sin(theta_rad) * cos(phi_rad), sin(theta_rad) * sin(phi_rad), cos(theta_rad));
}
