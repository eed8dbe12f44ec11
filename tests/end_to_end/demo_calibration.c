#include "demo_calibration.h"
#include "base/robust.h"

#include "lib/calibration_fixture.h"

#define ARC_STEP_DEG 30

struct comparing {
    struct fixture fixture; /* as cameras are compared by */
    World *world;
    const struct calibration *found;
    double azimuth_rad;
};

static struct vec3 from_truth(const struct comparing *c, const double p[3]) {
    return rig_turn(vec3(p[0], p[1], p[2]), -c->azimuth_rad);
}

static double apart_deg(struct vec3 a, struct vec3 b) {
    return FIXTURE_DEG(atan2(vec3_length(vec3_cross(a, b)), vec3_dot(a, b)));
}

static void compare_lamps(const struct comparing *c, struct demo_errors *ret) {
    const struct rig *rig = &c->found->rig;
    double cross = 0, dot = 0;
    for (int i = 0; i < rig->n_lamps; i++)
        for (int deg = 0; deg < 360; deg += ARC_STEP_DEG) {
            double p[3];
            truth_lamp(c->world, i, deg, p, NULL);
            const struct vec3 truth = from_truth(c, p);
            const struct vec3 at =
                rig_lamp_position_mm(&rig->arc, &rig->lamps[i], FIXTURE_RAD(deg));
            ret->lamp_deg = MAX(ret->lamp_deg, apart_deg(at, truth));
            ret->lamp_pct =
                MAX(ret->lamp_pct, 100 * fabs(vec3_length(at) / vec3_length(truth) - 1));
            cross += at.x * truth.y - at.y * truth.x;
            dot += at.x * truth.x + at.y * truth.y;
        }
    ret->arc_zero_deg = fabs(FIXTURE_DEG(atan2(cross, dot)));
}

/* Where the true sheet goes through the sample: from points of it to the sheet that was found. */
static double sheet_off_mm(const struct vec3 n, double offset_mm, const struct rig_plane *sheet) {
    double worst = 0;
    for (int i = 0; i < 27; i++) {
        const struct vec3 p = vec3(25.0 * (i % 3 - 1), 25.0 * (i / 3 % 3 - 1), 5.0 * (i / 9));
        const double off = vec3_dot(n, p) - offset_mm;
        if (fabs(off) > 25)
            continue;
        const struct vec3 q = vec3_sub(p, vec3_scale(n, off));
        worst = MAX(worst, fabs(vec3_dot(sheet->normal, q) - sheet->offset_mm));
    }
    return worst;
}

static void compare_sheets(const struct comparing *c, const struct demo_step *steps, int n,
                           struct demo_errors *ret) {
    const struct rig *rig = &c->found->rig;
    for (int i = 0; i < n; i++) {
        struct truth_sheet truth;
        truth_laser_sheet(c->world, steps[i].laser, steps[i].arc_deg, steps[i].sweep_deg, &truth);
        const struct rig_plane sheet =
            rig_laser_sheet(&rig->arc, &rig->lasers[steps[i].laser], FIXTURE_RAD(steps[i].arc_deg),
                            FIXTURE_RAD(steps[i].sweep_deg));
        const struct vec3 normal = from_truth(c, truth.normal);
        ret->sheet_deg = MAX(ret->sheet_deg, apart_deg(normal, sheet.normal));
        ret->sheet_mm = MAX(ret->sheet_mm, sheet_off_mm(normal, truth.offset_mm, &sheet));
    }
}

/* DN a second of white, as the calibration has it. */
static double shown(const struct comparing *c, int camera, int lamp, double arc_deg, struct vec3 p,
                    int colour) {
    const struct rig *rig = &c->found->rig;
    const struct radiometry_camera *of_camera = &c->found->camera_radiometry[camera];
    const struct radiometry_lamp *of_lamp = &c->found->lamp_radiometry[lamp];
    double x, y, value = rig->cameras[camera].response / G_PI;
    const struct vec3 at = rig_lamp_position_mm(&rig->arc, &rig->lamps[lamp], FIXTURE_RAD(arc_deg));
    g_assert_true(rig_project(&rig->cameras[camera], p, &x, &y));
    value *= radiometry_flat(&rig->cameras[camera], of_camera, x, y) *
             rig_lamp_irradiance(&rig->arc, &rig->lamps[lamp], FIXTURE_RAD(arc_deg), p) *
             MAX(vec3_unit(vec3_sub(at, p)).z, 0);
    return value * (of_camera->known ? of_camera->colour[colour] : 1) *
           (of_lamp->known ? of_lamp->colour[colour] : 1);
}

static void compare_light(const struct comparing *c, struct demo_errors *ret) {
    const struct rig *rig = &c->found->rig;
    g_autoptr(GArray) errors = g_array_new(FALSE, FALSE, sizeof(double));
    for (int camera = 0; camera < rig->n_cameras; camera++)
        for (int lamp = 0; lamp < rig->n_lamps; lamp++)
            for (int i = 0; i < 9 * 4 * 3; i++) {
                const struct vec3 p = vec3(20.0 * (i % 3 - 1), 20.0 * (i / 3 % 3 - 1), 2);
                const double arc_deg = 45 + 90.0 * (i / 9 % 4);
                const struct vec3 turned = rig_turn(p, c->azimuth_rad);
                const double truth =
                    truth_white(c->world, camera, lamp, arc_deg,
                                (const double[3]){turned.x, turned.y, turned.z}, i / 36);
                const double error = fabs(shown(c, camera, lamp, arc_deg, p, i / 36) / truth - 1);
                g_array_append_val(errors, error);
            }
    g_array_sort(errors, robust_by_value);
    ret->light_median = g_array_index(errors, double, errors->len / 2);
    ret->light_worst = g_array_index(errors, double, errors->len - 1);
}

static struct comparing comparing(World *world, const struct rig *rig) {
    struct comparing c = {.world = world, .fixture.worlds = {world}, .fixture.nominal = *rig};
    c.azimuth_rad = boards_azimuth_rad(&c.fixture, rig);
    return c;
}

void demo_errors_of(World *world, const struct calibration *calibration,
                    const struct demo_step *steps, int n, struct demo_errors *ret) {
    struct comparing c = comparing(world, &calibration->rig);
    c.found = calibration;
    *ret = (struct demo_errors){0};
    const struct fixture_errors errors = boards_compare(&c.fixture, c.found);
    ret->camera_px = errors.point_px;
    ret->camera_deg = errors.direction_deg;
    ret->camera_pct = errors.distance_pct;
    ret->axis_mm = errors.axis_mm;
    ret->axis_deg = errors.axis_deg;
    compare_lamps(&c, ret);
    compare_sheets(&c, steps, n, ret);
    compare_light(&c, ret);
}

double demo_azimuth_rad(World *world, const struct rig *rig) {
    return comparing(world, rig).azimuth_rad;
}
