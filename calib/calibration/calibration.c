/* This file makes, changes and writes calibrations, compares a calibration with the nominal rig,
 * and computes the covariance of a camera's line of sight and the age of a part. */
#include "calibration.h"

#include "base/input_file.h"
#include "base/output_file.h"
#include "radiometry/fiducials.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#define MAX_BYTES (16 << 20)
#define STEP      0.1 /* step of numerical derivatives, in standard errors of a parameter */

const char *calibration_part_name(enum calibration_kind kind) {
    static const char *const names[] = {"cameras", "lights", "laser", "radiometry"};

    return names[kind];
}

char *calibration_line(const struct calibration *calibration, const char *from,
                       const char *how_to) {
    g_autoptr(GString) has = g_string_new(NULL), lacks = g_string_new(NULL);
    for (int i = 0; i < CALIBRATION_PARTS; i++) {
        GString *to = calibration->parts[i].done ? has : lacks;
        g_string_append_printf(to, "%s%s", to->len ? ", " : "",
                               calibration_part_name((enum calibration_kind)i));
    }
    if (has->len == 0)
        return g_strdup_printf("none: geometry and light are nominal (%s)", how_to);
    return g_strdup_printf("%s (%s%s%s)", from, has->str, lacks->len ? "; not calibrated: " : "",
                           lacks->str);
}

static void clear_part(struct calibration_part *part) {
    g_free(part->date);
    g_free(part->method);
    g_free(part->residual_unit);
    g_free(part->checksum);
    g_clear_pointer(&part->rejected, g_ptr_array_unref);
    memset(part, 0, sizeof *part);
}

struct calibration *calibration_new(const struct rig *nominal) {
    struct calibration *calibration = g_new0(struct calibration, 1);

    calibration->rig = *nominal;
    calibration->extra = g_key_file_new();
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        calibration->parts[i].rejected = g_ptr_array_new_with_free_func(g_free);
    return calibration;
}

void calibration_free(struct calibration *calibration) {
    if (!calibration)
        return;
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        clear_part(&calibration->parts[i]);
    g_key_file_unref(calibration->extra);
    g_free(calibration);
}

/* The unit of the residual is px unless the caller changes it. */
struct calibration_part *calibration_set_part(struct calibration *calibration,
                                              enum calibration_kind kind, const char *method,
                                              int pictures, const char *checksum,
                                              GPtrArray *rejected) {
    struct calibration_part *part = &calibration->parts[kind];
    g_autoptr(GDateTime) now = g_date_time_new_now_utc();

    clear_part(part);
    part->done = TRUE;
    part->date = g_date_time_format(now, "%Y-%m-%dT%H:%M:%SZ");
    part->method = g_strdup(method);
    part->residual_unit = g_strdup("px");
    part->pictures = pictures;
    part->checksum = g_strdup(checksum);
    part->rejected = rejected ? rejected : g_ptr_array_new_with_free_func(g_free);
    return part;
}

static void turn_pair(double *x, double *y, double angle_rad) {
    const double c = cos(angle_rad), s = sin(angle_rad), was = *x;
    *x = c * was - s * *y;
    *y = s * was + c * *y;
}

/* Rotates the n × n covariance C by angle_rad about z: C becomes T C Tᵀ. The rows and columns with
 * the indices `at` and `at + 1` belong to x and y. */
static void turn_covariance(double *covariance, int n, int at, double angle_rad) {
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < n; i++) {
            double *x = covariance + (side ? i * n + at : at * n + i), *y = x + (side ? 1 : n);
            turn_pair(x, y, angle_rad);
        }
}

/* Rotates the standard errors of x and y. Their covariance is not stored and is taken as 0. */
static void turn_errors(double errors[2], double angle_rad) {
    const double c = cos(angle_rad), s = sin(angle_rad), x = errors[0], y = errors[1];
    errors[0] = hypot(c * x, s * y);
    errors[1] = hypot(s * x, c * y);
}

/* A camera must give the same R p + t for the turned point p' = T p: therefore R becomes R Tᵀ, and
 * the error ω of R = R₀ (1 + [ω]×) becomes T ω. */
void calibration_turn(struct calibration *calibration, double angle_rad) {
    struct rig *rig = &calibration->rig;
    for (int i = 0; i < rig->n_cameras; i++) {
        struct mat3 *rotation = &rig->cameras[i].rotation;
        for (int row = 0; row < 3; row++) {
            const struct vec3 turned = rig_turn(
                vec3(rotation->m[row][0], rotation->m[row][1], rotation->m[row][2]), angle_rad);
            rotation->m[row][0] = turned.x;
            rotation->m[row][1] = turned.y;
        }
        struct calibration_camera *errors = &calibration->cameras[i];
        turn_covariance(&errors->covariance[0][0], CALIBRATION_CAMERA_PARAMETERS,
                        CALIBRATION_TURN_X, angle_rad);
        for (gsize row = 0; row < G_N_ELEMENTS(errors->further_covariance); row++)
            turn_pair(&errors->further_covariance[row][CALIBRATION_TURN_X],
                      &errors->further_covariance[row][CALIBRATION_TURN_Y], angle_rad);
    }
    for (int i = 0; i < rig->n_lamps; i++) {
        rig->lamps[i].position_mm = rig_turn(rig->lamps[i].position_mm, angle_rad);
        rig->lamps[i].aim = rig_turn(rig->lamps[i].aim, angle_rad);
        turn_covariance(&calibration->lamps[i].position_covariance_mm2[0][0], 3, 0, angle_rad);
    }
    for (int i = 0; i < rig->n_lasers; i++) {
        struct rig_laser *laser = &rig->lasers[i];
        laser->position_mm = rig_turn(laser->position_mm, angle_rad);
        laser->axis = rig_turn(laser->axis, angle_rad);
        laser->normal = rig_turn(laser->normal, angle_rad);
        turn_errors(calibration->lasers[i].position_mm, angle_rad);
    }
    for (int i = 0; i < rig->n_fiducials; i++) {
        rig->fiducials[i].centre_mm = rig_turn(rig->fiducials[i].centre_mm, angle_rad);
        turn_errors(calibration->fiducials[i].centre_mm, angle_rad);
    }
    struct rig_swing *const swings[] = {&rig->arm, &rig->probe};
    for (gsize i = 0; i < G_N_ELEMENTS(swings); i++) {
        swings[i]->axis = rig_turn(swings[i]->axis, angle_rad);
        swings[i]->centre_mm = rig_turn(swings[i]->centre_mm, angle_rad);
    }
    for (int k = 0; k < RIG_WOBBLE_HARMONICS; k++)
        for (int of = 0; of < 2; of++) { /* the coefficients of cos kτ, then those of sin kτ */
            double *rad = rig->wobble.rad[k];
            const struct vec3 turned = rig_turn(vec3(rad[of], rad[2 + of], 0), angle_rad);
            rad[of] = turned.x;
            rad[2 + of] = turned.y;
        }
    double *const pairs[] = {rig->arc.tilt_rad, rig->arc.centre_mm};
    for (gsize k = 0; k < G_N_ELEMENTS(pairs); k++) {
        const struct vec3 turned = rig_turn(vec3(pairs[k][0], pairs[k][1], 0), angle_rad);
        pairs[k][0] = turned.x;
        pairs[k][1] = turned.y;
    }
    turn_errors(calibration->arc.tilt_rad, angle_rad);
    turn_errors(calibration->arc.centre_mm, angle_rad);
}

/* A newline follows each string in the hashed text, so "ab", "c" and "a", "bc" have different
 * checksums. */
char *calibration_checksum(const char *const *checksums, int n) {
    g_autoptr(GChecksum) sum = g_checksum_new(G_CHECKSUM_SHA256);

    for (int i = 0; i < n; i++) {
        g_checksum_update(sum, (const guchar *)checksums[i], (gssize)strlen(checksums[i]));
        g_checksum_update(sum, (const guchar *)"\n", 1);
    }
    return g_strdup(g_checksum_get_string(sum));
}

/* The text is first parsed again, because a file that cannot be read must not replace a file that
 * can be read. */
gboolean calibration_write(const struct calibration *calibration, const char *path,
                           GError **error) {
    g_autofree char *text = calibration_to_text(calibration);
    g_autoptr(Calibration) readable = calibration_from_text(text, path, error);

    if (!readable) {
        g_prefix_error(error, "the calibration is not written, because it cannot be read back: ");
        return FALSE;
    }
    g_autofree char *whole = g_strconcat("# " OUTPUT_FILE_TEXT("calibration") "\n", text, NULL);
    return output_file_write(path, whole, strlen(whole), error);
}

struct calibration *calibration_read(const char *path, GError **error) {
    GError *why = NULL;
    g_autofree char *text = input_file_read_text(path, MAX_BYTES, &why);

    if (text)
        return calibration_from_text(text, path, error);
    input_file_propagate(why, RIG_ERROR, -1, RIG_ERROR_FORMAT, error);
    return NULL;
}

/* Compares the name of a lamp or laser, and whether the arc carries it, with the rig file. Returns
 * a text that describes the difference, or NULL if there is none. */
static char *differ(const char *what, int index, const char *name, int fixed,
                    const char *nominal_name, int nominal_fixed) {
    static const char *const stands[] = {"is carried by the arc", "stands by itself"};

    if (strcmp(name, nominal_name) != 0)
        return g_strdup_printf("%s %d, counted from 1, is %s, but in the rig file it is %s", what,
                               index + 1, name, nominal_name);
    if (fixed != nominal_fixed)
        return g_strdup_printf("%s %s %s, but in the rig file it %s", what, name, stands[fixed],
                               stands[nominal_fixed]);
    return NULL;
}

/* The devices are compared by index, because the calibration lists them in the order of the rig
 * file. Names and sizes are then compared. */
gboolean calibration_check_rig(const struct calibration *calibration, const char *path,
                               const struct rig *nominal, GError **error) {
    const struct rig *rig = &calibration->rig;
    g_autofree char *why = NULL;

    if (strcmp(rig->id, nominal->id) != 0)
        why = g_strdup_printf("it is a calibration of rig %s, but this is rig %s", rig->id,
                              nominal->id);
    else if (rig->n_cameras != nominal->n_cameras || rig->n_lamps != nominal->n_lamps ||
             rig->n_lasers != nominal->n_lasers)
        why = g_strdup_printf(
            "it has %d cameras, %d lamps and %d lasers, but the rig file has %d, %d and %d",
            rig->n_cameras, rig->n_lamps, rig->n_lasers, nominal->n_cameras, nominal->n_lamps,
            nominal->n_lasers);
    for (int i = 0; i < rig->n_cameras && !why; i++) {
        const struct rig_camera *a = &rig->cameras[i], *b = &nominal->cameras[i];
        if (strcmp(a->name, b->name) != 0 || a->width != b->width || a->height != b->height)
            why =
                g_strdup_printf("camera %d, counted from 1, is %s with %d × %d pixels, but in the "
                                "rig file it is %s "
                                "with %d × %d",
                                i + 1, a->name, a->width, a->height, b->name, b->width, b->height);
        else if (a->on_arm != b->on_arm || a->arm_deg != b->arm_deg || a->stop != b->stop)
            why = g_strdup_printf(
                "camera %s has another place on the camera arm than in the rig file", a->name);
    }
    for (int i = 0; i < rig->n_lamps && !why; i++)
        why = differ("lamp", i, rig->lamps[i].name, rig->lamps[i].fixed, nominal->lamps[i].name,
                     nominal->lamps[i].fixed);
    for (int i = 0; i < rig->n_lasers && !why; i++)
        why = differ("laser", i, rig->lasers[i].name, rig->lasers[i].fixed, nominal->lasers[i].name,
                     nominal->lasers[i].fixed);
    if (why)
        g_set_error(error, RIG_ERROR, RIG_ERROR_VALUE,
                    "%s: %s; a calibration is valid only for one rig, so give that of this rig, or "
                    "calibrate this rig",
                    path, why);
    return !why;
}

/* Returns the camera with one parameter changed by a step. A parameter of the rotation is treated
 * differently: a small rotation ω of the camera has the same effect as moving the point p to p + ω
 * × p. The point is then moved and the camera is not changed. */
static struct rig_camera camera_changed(const struct rig_camera *camera, int parameter, double step,
                                        struct vec3 *point_mm) {
    struct rig_camera c = *camera;
    double *const values[CALIBRATION_ALL_CAMERA_PARAMETERS] = {
        [CALIBRATION_FX] = &c.fx_px,
        [CALIBRATION_FY] = &c.fy_px,
        [CALIBRATION_CX] = &c.cx_px,
        [CALIBRATION_CY] = &c.cy_px,
        [CALIBRATION_K1] = &c.k1,
        [CALIBRATION_K2] = &c.k2,
        [CALIBRATION_K3] = &c.k3,
        [CALIBRATION_P1] = &c.p1,
        [CALIBRATION_P2] = &c.p2,
        [CALIBRATION_SHIFT_X] = &c.translation_mm.x,
        [CALIBRATION_SHIFT_Y] = &c.translation_mm.y,
        [CALIBRATION_SHIFT_Z] = &c.translation_mm.z,
        [CALIBRATION_K4] = &c.k4,
        [CALIBRATION_K5] = &c.k5,
        [CALIBRATION_K6] = &c.k6,
    };
    const int turn = parameter - CALIBRATION_TURN_X;
    if (values[parameter])
        *values[parameter] += step;
    else
        *point_mm = vec3_add(*point_mm, vec3_cross(vec3(turn == 0 ? step : 0, turn == 1 ? step : 0,
                                                        turn == 2 ? step : 0),
                                                   *point_mm));
    return c;
}

/* Computes J C Jᵀ, where C is the covariance of the camera. The derivatives J of the projection are
 * differences over STEP standard errors. */
gboolean calibration_sight(const struct calibration *calibration, int camera, struct vec3 point_mm,
                           double ret_px2[2][2]) {
    enum { KNOWN = CALIBRATION_CAMERA_PARAMETERS, ALL = CALIBRATION_ALL_CAMERA_PARAMETERS };
    const struct calibration_camera *errors = &calibration->cameras[camera];
    const struct rig_camera *at = &calibration->rig.cameras[camera];
    double j[ALL][2] = {{0}}, c[ALL][ALL], x, y;

    memset(ret_px2, 0, sizeof(double[2][2]));
    if (!errors->known || !rig_project(at, point_mm, &x, &y))
        return FALSE;
    for (int i = 0; i < ALL; i++)
        for (int k = 0; k < ALL; k++)
            c[i][k] = i >= KNOWN   ? errors->further_covariance[i - KNOWN][k]
                      : k >= KNOWN ? errors->further_covariance[k - KNOWN][i]
                                   : errors->covariance[i][k];
    for (int i = 0; i < ALL; i++) {
        const double step = STEP * sqrt(c[i][i]);
        struct vec3 point = point_mm;
        double moved[2];
        if (!(step > 0))
            continue;
        const struct rig_camera changed = camera_changed(at, i, step, &point);
        if (!rig_project(&changed, point, &moved[0], &moved[1]))
            continue;
        j[i][0] = (moved[0] - x) / step;
        j[i][1] = (moved[1] - y) / step;
    }
    for (int a = 0; a < ALL; a++)
        for (int b = 0; b < ALL; b++)
            for (int i = 0; i < 4; i++)
                ret_px2[i / 2][i % 2] += j[a][i / 2] * c[a][b] * j[b][i % 2];
    return TRUE;
}

double calibration_output_factor(const struct calibration *from, const struct calibration *to,
                                 int camera, int lamp, double turntable_rad, double arc_rad) {
    const struct calibration *const both[] = {from, to};
    struct fiducial_scene scenes[2];
    double sum = 0;
    int n = 0;
    for (int i = 0; i < 2; i++)
        scenes[i] = (struct fiducial_scene){.rig = &both[i]->rig,
                                            .camera = camera,
                                            .lamp = lamp,
                                            .turntable_rad = turntable_rad,
                                            .arc_rad = arc_rad,
                                            .radiometry = &both[i]->camera_radiometry[camera],
                                            .lamp_radiometry = &both[i]->lamp_radiometry[lamp]};
    for (int i = 0; i < MIN(from->rig.n_fiducials, to->rig.n_fiducials); i++) {
        const double was = fiducials_white(&scenes[0], i), is = fiducials_white(&scenes[1], i);
        if (was > 0 && is > 0) {
            sum += was / is;
            n++;
        }
    }
    return n > 0 ? sum / n : 1;
}

/* The result is also −1 if the date of the part is not in ISO 8601. */
double calibration_age_days(const struct calibration *calibration, enum calibration_kind kind) {
    const struct calibration_part *part = &calibration->parts[kind];
    g_autoptr(GDateTime) now = g_date_time_new_now_utc();
    g_autoptr(GDateTime) then = part->done ? g_date_time_new_from_iso8601(part->date, NULL) : NULL;

    return then ? (double)g_date_time_difference(now, then) / (24 * 3600e6) : -1;
}
