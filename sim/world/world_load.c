#include "world_private.h"

#include "base/nearest.h"
#include "base/options.h"

#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
/* sheet_bend_mm is the bend of the light sheet at this distance from the middle of the line */
#define BEND_AT_MM 36.0

struct world_options {
    int seed, supersample, n_gather, cache_mb;
    gboolean noise;
    double arc_zero_deg, arc_tilt_deg, arc_mm;
    double camera_mm, camera_deg, lamp_mm, lamp_deg, lamp_pct, laser_mm, laser_deg;
    double arm_axis_theta_deg, arm_axis_phi_deg, arm_zero_deg, arm_tilt_deg, arm_mm;
    double probe_axis_theta_deg, probe_axis_phi_deg, probe_zero_deg, probe_tilt_deg, probe_mm;
    double warm_up_s, warm_up_start, drift_pct, drift_period_s;
    double table_albedo, table_radius_mm;
    double wobble_deg, speckle_contrast, bleeding_share, bleeding_mm, lamp_flicker;
    int wobble_per_turn;
};

#define AT(field) G_STRUCT_OFFSET(struct world_options, field)
static const struct option world_table[] = {
    {"seed", OPTION_INT, NULL, 0, 1e9, "1", NULL, AT(seed),
     "seed of the misalignments and the noise of this world"},
    {"noise", OPTION_BOOL, NULL, 0, 0, "yes", NULL, AT(noise), "photon and read noise"},
    {"supersample", OPTION_INT, NULL, 1, 8, "2", NULL, AT(supersample),
     "samples per pixel in x and in y"},
    {"gather_rays", OPTION_INT, NULL, 0, 64, "12", NULL, AT(n_gather),
     "rays per surface point for light after one diffuse bounce; 0: direct light only"},
    {"cache_mb", OPTION_INT, "MB", 1, 65536, "512", NULL, AT(cache_mb),
     "memory for the cached parts of frames"},
    {"arc_zero_error_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, AT(arc_zero_deg),
     "standard deviation of the true direction of the light arc's angle 0"},
    {"arc_tilt_error_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, AT(arc_tilt_deg),
     "standard deviation of the tilt of the light arc's axis, towards x and towards y"},
    {"arc_error_mm", OPTION_DOUBLE, "mm", 0, 10, "0", NULL, AT(arc_mm),
     "standard deviation of the position of the light arc's axis, along x and along y"},
    {"arm_axis_theta_deg", OPTION_DOUBLE, "deg", 0, 180, "90", NULL, AT(arm_axis_theta_deg),
     "direction of the camera arm's axis, from the zenith"},
    {"arm_axis_phi_deg", OPTION_DOUBLE, "deg", -360, 360, "90", NULL, AT(arm_axis_phi_deg),
     "azimuth of the camera arm's axis"},
    {"arm_zero_error_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, AT(arm_zero_deg),
     "standard deviation of the true direction of the camera arm's angle 0"},
    {"arm_tilt_error_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, AT(arm_tilt_deg),
     "standard deviation of the direction of the arm's axis, towards each of two sides"},
    {"arm_error_mm", OPTION_DOUBLE, "mm", 0, 10, "0", NULL, AT(arm_mm),
     "standard deviation of the position of the arm's axis, along x, y and z"},
    {"probe_axis_theta_deg", OPTION_DOUBLE, "deg", 0, 180, "90", NULL, AT(probe_axis_theta_deg),
     "direction of the light probe's axis, from the zenith"},
    {"probe_axis_phi_deg", OPTION_DOUBLE, "deg", -360, 360, "90", NULL, AT(probe_axis_phi_deg),
     "azimuth of the light probe's axis; if the probe is on the arc, with the arc at 0"},
    {"probe_zero_error_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, AT(probe_zero_deg),
     "standard deviation of the true direction of the light probe's angle 0"},
    {"probe_tilt_error_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, AT(probe_tilt_deg),
     "standard deviation of the direction of the probe's axis, towards each of two sides"},
    {"probe_error_mm", OPTION_DOUBLE, "mm", 0, 10, "0", NULL, AT(probe_mm),
     "standard deviation of the position of the probe's axis, along x, y and z"},
    {"camera_error_mm", OPTION_DOUBLE, "mm", 0, 10, "0", NULL, AT(camera_mm),
     "standard deviation of the cameras' positions, each axis"},
    {"camera_error_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, AT(camera_deg),
     "standard deviation of the cameras' rotations about each of their axes"},
    {"lamp_error_mm", OPTION_DOUBLE, "mm", 0, 10, "0", NULL, AT(lamp_mm),
     "standard deviation of the lamps' positions, each axis"},
    {"lamp_error_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, AT(lamp_deg),
     "standard deviation of the lamps' aim, about each of two axes"},
    {"lamp_error_pct", OPTION_DOUBLE, "%", 0, 20, "0", NULL, AT(lamp_pct),
     "standard deviation of the lamps' intensities"},
    {"laser_error_mm", OPTION_DOUBLE, "mm", 0, 10, "0", NULL, AT(laser_mm),
     "standard deviation of the lasers' positions, each axis"},
    {"laser_error_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, AT(laser_deg),
     "standard deviation of the laser sheets' tilt and of the sweep's zero"},
    {"warm_up_s", OPTION_DOUBLE, "s", 0, 3600, "2", NULL, AT(warm_up_s),
     "time until a lamp gives its full output"},
    {"warm_up_start", OPTION_DOUBLE, NULL, 0, 1, "0.8", NULL, AT(warm_up_start),
     "output just after switching on, as a share of the full output"},
    {"drift_pct", OPTION_DOUBLE, "%", 0, 50, "0", NULL, AT(drift_pct),
     "amplitude of the lamps' slow drift"},
    {"drift_period_s", OPTION_DOUBLE, "s", 1, 1e7, "3600", NULL, AT(drift_period_s),
     "period of the drift"},
    {"turntable_albedo", OPTION_DOUBLE, NULL, 0, 1, "0.04", NULL, AT(table_albedo),
     "albedo of the turntable's top, a diffuser"},
    {"turntable_radius_mm", OPTION_DOUBLE, "mm", 0, 1000, "150", NULL, AT(table_radius_mm),
     "radius of the turntable's top; beyond it everything is black"},
    {"bearing_wobble_deg", OPTION_DOUBLE, "deg", 0, 5, "0", NULL, AT(wobble_deg),
     "tilt of the turntable's axis by its bearing, about the middle of the turntable's top"},
    {"bearing_wobble_per_turn", OPTION_INT, NULL, 1, 36, "2", NULL, AT(wobble_per_turn),
     "number of turns of the direction of this tilt while the turntable turns once; with the "
     "turntable at 0 the axis leans towards the x of the rig"},
    {"lamp_flicker", OPTION_DOUBLE, NULL, 0, 0.5, "0", NULL, AT(lamp_flicker),
     "relative standard deviation of a lamp's output from frame to frame"},
    {"speckle_contrast", OPTION_DOUBLE, NULL, 0, 1, "0", NULL, AT(speckle_contrast),
     "contrast of laser speckle: standard deviation over mean of a pixel's light; the "
     "grain is as large as the blur of the lens (at least 0.5 px), and changes with every movement "
     "of laser, turntable or camera"},
    {"bleeding_share", OPTION_DOUBLE, NULL, 0, 1, "0", NULL, AT(bleeding_share),
     "share of the laser light reflected diffusely by the sample that has entered it and comes "
     "out elsewhere"},
    {"bleeding_mm", OPTION_DOUBLE, "mm", 0.2, 20, "0.6", NULL, AT(bleeding_mm),
     "distance over which this light decreases to 1/e"},
    {0},
};
#undef AT

struct camera_options {
    struct optics_camera optics;
    int cfa;
    gboolean on_arm;
    char *serial;
    double theta_deg, phi_deg, distance_mm, focal_scale;
    struct option_doubles offset_mm, turn_deg, centre_px, colour;
};

static const char *const cfa_choices[] = {"mono", "rggb", "bggr", "grbg", "gbrg", NULL};

#define AT(field) G_STRUCT_OFFSET(struct camera_options, field)
static const struct option camera_table[] = {
    {"theta_deg", OPTION_DOUBLE, "deg", 0, 89, NULL, NULL, AT(theta_deg), "angle from the zenith"},
    {"phi_deg", OPTION_DOUBLE, "deg", -360, 360, "0", NULL, AT(phi_deg), "azimuth"},
    {"distance_mm", OPTION_DOUBLE, "mm", 50, 10000, "650", NULL, AT(distance_mm),
     "distance from the origin, at which the camera looks"},
    {"on_arm", OPTION_BOOL, NULL, 0, 0, "no", NULL, AT(on_arm),
     "the camera arm carries the camera; its place is given with the arm at 0"},
    {"serial", OPTION_STRING, NULL, 0, 0, "", NULL, AT(serial),
     "serial number that the simulated camera reports"},
    {"width", OPTION_INT, "px", 1, 8192, "160", NULL, AT(optics.width), "columns"},
    {"height", OPTION_INT, "px", 1, 8192, "160", NULL, AT(optics.height), "rows"},
    {"focal_px", OPTION_DOUBLE, "px", 10, 1e6, "1664", NULL, AT(optics.focal_px),
     "focal length in pixels"},
    {"bits", OPTION_INT, NULL, 8, 16, "12", NULL, AT(optics.bits), "bits of the ADC"},
    {"cfa", OPTION_CHOICE, NULL, 0, 0, "rggb", cfa_choices, AT(cfa), "colour filters"},
    {"black_level", OPTION_DOUBLE, "DN", 0, 4096, "64", NULL, AT(optics.black_level),
     "mean value in the dark"},
    {"full_well_e", OPTION_DOUBLE, "e", 100, 1e7, "15000", NULL, AT(optics.full_well_e),
     "electrons that fill a pixel; at 0 dB the ADC's last value"},
    {"read_noise_e", OPTION_DOUBLE, "e", 0, 1000, "4", NULL, AT(optics.read_noise_e),
     "standard deviation of a pixel in the dark"},
    {"curvature", OPTION_DOUBLE, NULL, -0.2, 0.2, "0", NULL, AT(optics.curvature),
     "loss of signal of a full pixel against a straight line, as a share"},
    {"response", OPTION_DOUBLE, "DN/s per W/sr/m2", 0, 1e9, "6000", NULL, AT(optics.response),
     "response on the axis at 0 dB"},
    {"colour", OPTION_DOUBLES, NULL, 0, 10, "1;1;1", NULL, AT(colour),
     "factors of the response behind the red, green and blue filters"},
    {"vignetting", OPTION_DOUBLE, NULL, 0, 1, "0", NULL, AT(optics.vignetting),
     "share of light lost in the corners; it grows with the square of the distance from the "
     "centre"},
    {"falloff", OPTION_DOUBLE, NULL, 0, 8, "0", NULL, AT(optics.falloff),
     "fall-off over the picture: exponent of the cosine of the angle to the axis, 4 for a simple "
     "lens"},
    {"blur_px", OPTION_DOUBLE, "px", 0, 10, "0", NULL, AT(optics.blur_px),
     "standard deviation of the lens's blur; a pixel's samples are then spread over the blur"},
    {"k1", OPTION_DOUBLE, NULL, -2, 2, "0", NULL, AT(optics.k1), "radial distortion, r³"},
    {"k2", OPTION_DOUBLE, NULL, -2, 2, "0", NULL, AT(optics.k2), "radial distortion, r⁵"},
    {"p1", OPTION_DOUBLE, NULL, -0.1, 0.1, "0", NULL, AT(optics.p1), "tangential distortion"},
    {"p2", OPTION_DOUBLE, NULL, -0.1, 0.1, "0", NULL, AT(optics.p2), "tangential distortion"},
    {"focal_scale", OPTION_DOUBLE, NULL, 0.5, 2, "1", NULL, AT(focal_scale),
     "true focal length, relative to focal_px"},
    {"centre_px", OPTION_DOUBLES, "px", -1000, 1000, "0;0", NULL, AT(centre_px),
     "offset of the principal point from the frame's middle, x and y"},
    {"offset_mm", OPTION_DOUBLES, "mm", -100, 100, "0;0;0", NULL, AT(offset_mm),
     "offset of the true position, rig frame"},
    {"turn_deg", OPTION_DOUBLES, "deg", -30, 30, "0;0;0", NULL, AT(turn_deg),
     "rotation about the camera's own right, down and forward axes"},
    {"lateral_colour", OPTION_DOUBLE, NULL, -0.01, 0.01, "0", NULL, AT(optics.lateral_colour),
     "lateral colour: the lens magnifies red by 1 + this and blue by 1 - this about the principal "
     "point"},
    {"veiling_glare", OPTION_DOUBLE, NULL, 0, 0.5, "0", NULL, AT(optics.veiling_glare),
     "share of the frame's mean light that the lens adds everywhere"},
    {"half_gain_step", OPTION_DOUBLE, NULL, -0.5, 0.5, "0", NULL, AT(optics.half_gain_step),
     "ratio by which the right half of the sensor reads brighter than the left"},
    {"column_offset", OPTION_DOUBLE, NULL, 0, 0.1, "0", NULL, AT(optics.column_offset),
     "standard deviation of fixed offsets of the sensor's columns, as a share of full scale"},
    {0},
};
#undef AT

struct lamp_options {
    struct optics_lamp optics;
    gboolean dead, on_probe;
    double theta_deg, phi_deg, distance_mm, scale;
    struct option_doubles offset_mm, aim_deg;
};

#define AT(field) G_STRUCT_OFFSET(struct lamp_options, field)
static const struct option lamp_table[] = {
    {"theta_deg", OPTION_DOUBLE, "deg", 0, 89, NULL, NULL, AT(theta_deg), "angle from the zenith"},
    {"phi_deg", OPTION_DOUBLE, "deg", -360, 360, "0", NULL, AT(phi_deg),
     "azimuth of a lamp that stands by itself; without this key the arc carries the lamp"},
    {"distance_mm", OPTION_DOUBLE, "mm", 50, 10000, "500", NULL, AT(distance_mm),
     "distance from the origin, at which the lamp is aimed"},
    {"on_probe", OPTION_BOOL, NULL, 0, 0, "no", NULL, AT(on_probe),
     "the light probe carries the lamp; its place is given with the probe at 0"},
    {"exponent", OPTION_DOUBLE, NULL, 0, 100, "2", NULL, AT(optics.exponent),
     "intensity falls with the cosine of the angle to the aim to this power"},
    {"intensity", OPTION_DOUBLE, "W/sr", 0, 1e6, "40", NULL, AT(optics.intensity),
     "radiant intensity along the aim"},
    {"intensity_scale", OPTION_DOUBLE, NULL, 0, 2, "1", NULL, AT(scale),
     "true intensity, relative to intensity"},
    {"offset_mm", OPTION_DOUBLES, "mm", -100, 100, "0;0;0", NULL, AT(offset_mm),
     "offset of the true position, with the arc at 0"},
    {"aim_deg", OPTION_DOUBLES, "deg", -30, 30, "0;0", NULL, AT(aim_deg),
     "rotation of the true aim along and across the arc"},
    {"dead", OPTION_BOOL, NULL, 0, 0, "no", NULL, AT(dead), "the lamp gives no light at all"},
    {0},
};
#undef AT

struct laser_options {
    struct optics_laser optics;
    double theta_deg, phi_deg, distance_mm, width_mm, fan_deg, tilt_deg, start_deg, sheet_bend_mm;
    struct option_doubles offset_mm, colour;
};

#define AT(field) G_STRUCT_OFFSET(struct laser_options, field)
static const struct option laser_table[] = {
    {"theta_deg", OPTION_DOUBLE, "deg", 0, 89, NULL, NULL, AT(theta_deg), "angle from the zenith"},
    {"phi_deg", OPTION_DOUBLE, "deg", -360, 360, "0", NULL, AT(phi_deg),
     "azimuth of a laser that stands by itself; without this key the arc carries the laser"},
    {"distance_mm", OPTION_DOUBLE, "mm", 50, 10000, "480", NULL, AT(distance_mm),
     "distance from the origin, which the laser lights at sweep angle 0"},
    {"width_mm", OPTION_DOUBLE, "mm", 0.01, 20, "1.2", NULL, AT(width_mm),
     "width of the line at the origin, full width at half maximum"},
    {"fan_deg", OPTION_DOUBLE, "deg", 1, 120, "20", NULL, AT(fan_deg),
     "opening angle of the sheet"},
    {"power_w", OPTION_DOUBLE, "W", 0, 1000, "0.02", NULL, AT(optics.power_w),
     "power of the whole sheet"},
    {"colour", OPTION_DOUBLES, NULL, 0, 10, "1;1;1", NULL, AT(colour),
     "response of red, green and blue pixels to the laser, relative to their response to lamps"},
    {"tilt_deg", OPTION_DOUBLE, "deg", -10, 10, "0", NULL, AT(tilt_deg),
     "rotation of the sheet about its direction"},
    {"start_deg", OPTION_DOUBLE, "deg", -10, 10, "0", NULL, AT(start_deg),
     "sweep angle at which the laser truly lights the origin"},
    {"sheet_bend_mm", OPTION_DOUBLE, "mm", -10, 10, "0", NULL, AT(sheet_bend_mm),
     "bend of the sheet, a parabola: distance of the sheet from a plane, in the direction of the "
     "sweep, at 36 mm on both sides of the middle of the line that it draws through the origin"},
    {"offset_mm", OPTION_DOUBLES, "mm", -100, 100, "0;0;0", NULL, AT(offset_mm),
     "offset of the true position, with the arc at 0"},
    {0},
};
#undef AT

/* Returns the random number generator of a device. It depends on the world's seed, on a letter for
 * the class of the device, and on the number of the device among those of its class in the file. */
static struct sample_random device_random(const struct world_options *options, char class_letter,
                                          int index) {
    guint64 seed = (guint64)options->seed << 16 | (guint64)class_letter << 8 | (guint64)index;
    return (struct sample_random){sample_hash(seed + 0x9e3779b97f4a7c15u)};
}

static struct v3 deviate3(struct sample_random *random) {
    double x = sample_deviate(random), y = sample_deviate(random), z = sample_deviate(random);
    return v3(x, y, z);
}

static gboolean check_count(const struct config_section *section, const char *key,
                            const struct option_doubles *list, int n, Mistakes *mistakes) {
    if (list->n == n)
        return TRUE;
    config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                   "needs %d numbers with ';' between them, but has %d", n, list->n);
    return FALSE;
}

static struct v3 vector(const struct option_doubles *list) {
    return v3(list->values[0], list->values[1], list->values[2]);
}

static gboolean load_camera(World *world, const struct world_options *all,
                            const struct config_section *section, Mistakes *mistakes) {
    struct camera_options from = {0};
    if (!options_read(&(struct option_target){camera_table, &from}, 1, section, NULL, mistakes))
        return FALSE;
    gboolean good = check_count(section, "offset_mm", &from.offset_mm, 3, mistakes) &
                    check_count(section, "turn_deg", &from.turn_deg, 3, mistakes) &
                    check_count(section, "centre_px", &from.centre_px, 2, mistakes) &
                    check_count(section, "colour", &from.colour, 3, mistakes);
    if (good && from.optics.black_level >= (double)((1 << from.optics.bits) - 1)) {
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "black_level",
                       "is %g, but must be below the largest value of %d bits; give a smaller "
                       "black_level or more bits",
                       from.optics.black_level, from.optics.bits);
        good = FALSE;
    }
    if (good) {
        struct sample_random random = device_random(all, 'c', world->n_cameras);
        struct optics_camera *camera = &world->cameras[world->n_cameras];
        *camera = from.optics;
        camera->cfa = (enum cfa)from.cfa;
        camera->focal_px *= from.focal_scale;
        camera->centre_x_px = (camera->width - 1) / 2.0 + from.centre_px.values[0];
        camera->centre_y_px = (camera->height - 1) / 2.0 + from.centre_px.values[1];
        for (int i = 0; i < 3; i++)
            camera->colour[i] = from.colour.values[i];
        optics_camera_place(camera, RAD(from.theta_deg), RAD(from.phi_deg), from.distance_mm);
        camera->centre_mm = v3_mad(vector(&from.offset_mm), 1, camera->centre_mm);
        camera->centre_mm = v3_mad(deviate3(&random), all->camera_mm, camera->centre_mm);
        struct v3 turn = v3_mad(deviate3(&random), all->camera_deg, vector(&from.turn_deg));
        optics_camera_turn(camera, RAD(turn.x), RAD(turn.y), RAD(turn.z));
        camera->columns_key = device_random(all, 'k', world->n_cameras).state;
        world->camera_on_arm[world->n_cameras] = from.on_arm;
        world->camera_serials[world->n_cameras] = g_strdup(from.serial);
        world->camera_names[world->n_cameras++] = g_strdup(section->name);
    }
    options_clear(camera_table, &from);
    return good;
}

/* Returns the direction from the origin to a device at a polar angle and an azimuth. For a device
 * on the arc, the azimuth is 0. Sets *ret_up to the unit vector upwards along the arc, and
 * *ret_across to the unit vector across the arc. */
static struct v3 on_arc(double theta_deg, double phi_deg, struct v3 *ret_up,
                        struct v3 *ret_across) {
    double theta = RAD(theta_deg), c = cos(RAD(phi_deg)), s = sin(RAD(phi_deg));
    *ret_up = v3_turn_z(v3(-cos(theta), 0, sin(theta)), c, s);
    *ret_across = v3_turn_z(v3(0, 1, 0), c, s);
    return v3_turn_z(v3(sin(theta), 0, cos(theta)), c, s);
}

static gboolean load_lamp(World *world, const struct world_options *all,
                          const struct config_section *section, Mistakes *mistakes) {
    struct lamp_options from = {0};
    if (!options_read(&(struct option_target){lamp_table, &from}, 1, section, NULL, mistakes))
        return FALSE;
    gboolean good = check_count(section, "offset_mm", &from.offset_mm, 3, mistakes) &
                    check_count(section, "aim_deg", &from.aim_deg, 2, mistakes);
    if (good) {
        struct sample_random random = device_random(all, 'l', world->n_lamps);
        struct optics_lamp *lamp = &world->lamps[world->n_lamps];
        *lamp = from.optics;
        struct v3 up, across, out = on_arc(from.theta_deg, from.phi_deg, &up, &across);
        lamp->position_mm = v3_mad(out, from.distance_mm, vector(&from.offset_mm));
        lamp->position_mm = v3_mad(deviate3(&random), all->lamp_mm, lamp->position_mm);
        double along = from.aim_deg.values[0] + all->lamp_deg * sample_deviate(&random);
        double aside = from.aim_deg.values[1] + all->lamp_deg * sample_deviate(&random);
        struct v3 aim = v3_mad(up, tan(RAD(along)), v3(-out.x, -out.y, -out.z));
        lamp->aim = v3_norm(v3_mad(across, tan(RAD(aside)), aim));
        lamp->intensity *= from.scale * (1 + all->lamp_pct / 100 * sample_deviate(&random));
        lamp->intensity = MAX(lamp->intensity, 0);
        world->power[world->n_lamps].dead = from.dead;
        world->lamp_fixed[world->n_lamps] = config_value(section, "phi_deg", NULL) != NULL;
        world->lamp_on_probe[world->n_lamps] = from.on_probe;
        world->lamp_names[world->n_lamps++] = g_strdup(section->name);
    }
    options_clear(lamp_table, &from);
    return good;
}

static gboolean load_laser(World *world, const struct world_options *all,
                           const struct config_section *section, Mistakes *mistakes) {
    struct laser_options from = {0};
    if (!options_read(&(struct option_target){laser_table, &from}, 1, section, NULL, mistakes))
        return FALSE;
    gboolean good = check_count(section, "offset_mm", &from.offset_mm, 3, mistakes) &
                    check_count(section, "colour", &from.colour, 3, mistakes);
    if (good) {
        struct sample_random random = device_random(all, 's', world->n_lasers);
        struct optics_laser *laser = &world->lasers[world->n_lasers];
        *laser = from.optics;
        struct v3 up, across, out = on_arc(from.theta_deg, from.phi_deg, &up, &across);
        laser->position_mm = v3_mad(out, from.distance_mm, vector(&from.offset_mm));
        laser->position_mm = v3_mad(deviate3(&random), all->laser_mm, laser->position_mm);
        double tilt = RAD(from.tilt_deg + all->laser_deg * sample_deviate(&random));
        laser->start = RAD(from.start_deg + all->laser_deg * sample_deviate(&random));
        laser->forward = v3(-out.x, -out.y, -out.z);
        laser->axis = v3_mad(up, sin(tilt), v3_mad(across, cos(tilt), v3(0, 0, 0)));
        laser->sigma = from.width_mm / (2 * sqrt(2 * G_LN2)) / from.distance_mm;
        laser->fan = RAD(from.fan_deg);
        laser->bend = from.sheet_bend_mm * from.distance_mm / (BEND_AT_MM * BEND_AT_MM);
        for (int i = 0; i < 3; i++)
            laser->colour[i] = from.colour.values[i];
        world->laser_fixed[world->n_lasers] = config_value(section, "phi_deg", NULL) != NULL;
        world->laser_place[world->n_lasers] = world->n_lasers;
        world->laser_names[world->n_lasers++] = g_strdup(section->name);
    }
    options_clear(laser_table, &from);
    return good;
}

struct mark_options {
    double x_mm, y_mm, z_mm, radius_mm;
    struct option_doubles albedo;
};

#define AT(field) G_STRUCT_OFFSET(struct mark_options, field)
static const struct option mark_table[] = {
    {"x_mm", OPTION_DOUBLE, "mm", -1000, 1000, NULL, NULL, AT(x_mm),
     "x of the disc's middle, sample frame"},
    {"y_mm", OPTION_DOUBLE, "mm", -1000, 1000, NULL, NULL, AT(y_mm), "y of the disc's middle"},
    {"z_mm", OPTION_DOUBLE, "mm", 0.01, 100, "1", NULL, AT(z_mm),
     "height of the disc's face above the turntable"},
    {"radius_mm", OPTION_DOUBLE, "mm", 0.1, 100, "3", NULL, AT(radius_mm),
     "radius of the disc's face"},
    {"albedo", OPTION_DOUBLES, NULL, 0, 1, "0.95", NULL, AT(albedo),
     "albedo of the disc's face, one value or three; its sides are black"},
    {0},
};
#undef AT

static void load_mark(World *world, const struct config_section *section, Mistakes *mistakes) {
    struct mark_options mark = {0};
    float albedo[3];
    if (!options_read(&(struct option_target){mark_table, &mark}, 1, section, NULL, mistakes))
        return;
    sample_set_rgb(albedo, &mark.albedo, 0.95f, 0.95f, 0.95f);
    if (world->mesh)
        sample_add_post(world->mesh, mark.x_mm, mark.y_mm, mark.z_mm, mark.radius_mm, albedo);
    options_clear(mark_table, &mark);
}

/* Loads the sample, and adds the marks of the world file to its mesh. Then builds the scene, if
 * there are no mistakes. If all_sections is TRUE, a missing [sample] is a mistake. */
static void load_sample(World *world, const struct world_options *all, const Config *config,
                        gboolean all_sections, Mistakes *mistakes) {
    const struct config_section *section = config_find(config, "sample", NULL);
    struct sample_options options = {0};
    gsize n = 0;
    if (!section && all_sections)
        config_lacks(mistakes, config,
                     "the section [sample] is missing; add [sample] with the key kind, which says "
                     "what lies on the turntable (kind = flat, …)");
    if (section && options_read(&(struct option_target){sample_option_table, &options}, 1, section,
                                NULL, mistakes)) {
        world->mesh = sample_new(section, &options, mistakes);
        options_clear(sample_option_table, &options);
    }
    const struct config_section *sections = config_sections(config, &n);
    for (gsize i = 0; i < n; i++)
        if (!sections[i].broken && g_str_equal(sections[i].class_name, "mark"))
            load_mark(world, &sections[i], mistakes);
    if (mistakes_count(mistakes) > 0)
        return;
    world->scene.n_gather = all->n_gather;
    world->scene.table_albedo = (float)all->table_albedo;
    world->scene.table_radius_mm = (float)all->table_radius_mm;
    scene_init(&world->scene, world->mesh, all->seed);
    if (world->bleeding_share > 0)
        world->bleeding = bleeding_new(&world->scene, all->bleeding_mm);
}

typedef gboolean (*LoadDevice)(World *, const struct world_options *, const struct config_section *,
                               Mistakes *);

/* Loads a camera, lamp or laser. Adds a mistake if the section has no name, or if there are too
 * many sections of its class. For the other sections of world files, does nothing. Returns TRUE in
 * all these cases. If a world file cannot have such a section, adds a mistake and returns FALSE. */
static gboolean load_section(World *world, const struct world_options *all,
                             const struct config_section *section, Mistakes *mistakes) {
    const struct {
        const char *class_name;
        LoadDevice load;
        int n, max;
    } classes[] = {
        {"camera", load_camera, world->n_cameras, WORLD_MAX_CAMERAS},
        {"lamp", load_lamp, world->n_lamps, WORLD_MAX_LAMPS},
        {"laser", load_laser, world->n_lasers, WORLD_MAX_LASERS},
    };
    if (g_str_equal(section->group, "world") || g_str_equal(section->group, "sample") ||
        g_str_equal(section->class_name, "mark"))
        return TRUE;
    for (gsize i = 0; i < G_N_ELEMENTS(classes); i++) {
        if (!g_str_equal(section->class_name, classes[i].class_name))
            continue;
        if (section->name && classes[i].n < classes[i].max)
            classes[i].load(world, all, section, mistakes);
        else if (section->name)
            config_mistake(mistakes, CONFIG_ERROR_VALUE, section, NULL,
                           "is one section too many: a world has at most %d sections of this "
                           "class; remove a section",
                           classes[i].max);
        else
            config_mistake(mistakes, CONFIG_ERROR_VALUE, section, NULL,
                           "needs a name; write [%s NAME]", section->class_name);
        return TRUE;
    }
    static const char *const names[] = {"world", "sample", "camera", "lamp", "laser", "mark"};
    struct nearest nearest = nearest_new(section->class_name);
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++)
        nearest_consider(&nearest, names[i]);
    if (nearest.name)
        return config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, NULL,
                              "there is no such section; did you mean [%s]?", nearest.name);
    return config_mistake(
        mistakes, CONFIG_ERROR_UNKNOWN, section, NULL,
        "there is no such section; a world file has [world], [sample], [camera NAME], [lamp NAME], "
        "[laser NAME] and [mark NAME]");
}

const struct option *world_section_options(const char *class_name) {
    static const struct {
        const char *class_name;
        const struct option *options;
    } tables[] = {{"world", world_table}, {"sample", sample_option_table}, {"camera", camera_table},
                  {"lamp", lamp_table},   {"laser", laser_table},          {"mark", mark_table}};
    for (gsize i = 0; i < G_N_ELEMENTS(tables); i++)
        if (g_str_equal(class_name, tables[i].class_name))
            return tables[i].options;
    return NULL;
}

/* Returns the axis of the arm or probe, with random deviations from the nominal axis. The standard
 * deviations are zero_deg for the zero, tilt_deg for the tilt in each of two directions, and off_mm
 * for the offset in each of x, y and z. letter is the class_letter of device_random(). */
static struct optics_swing swing_of(const struct world_options *all, char letter, double theta_deg,
                                    double phi_deg, double zero_deg, double tilt_deg,
                                    double off_mm) {
    struct sample_random random = device_random(all, letter, 0);
    struct v3 up, across, out = on_arc(theta_deg, phi_deg, &up, &across);
    struct optics_swing swing = {.zero = RAD(zero_deg * sample_deviate(&random))};
    struct v3 lean = deviate3(&random);
    out = v3_mad(up, RAD(tilt_deg) * lean.x, v3_mad(across, RAD(tilt_deg) * lean.y, out));
    swing.axis = v3_norm(out);
    swing.centre_mm = v3_mad(deviate3(&random), off_mm, v3(0, 0, 0));
    return swing;
}

gboolean world_load(World *world, const char *path, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    g_autoptr(Config) config = config_load_checked(path, mistakes);
    if (!config)
        return mistakes_report(mistakes, error);
    struct world_options all = {0};
    const struct config_section *head = config_find(config, "world", NULL);
    if (!head || !options_read(&(struct option_target){world_table, &all}, 1, head, NULL, mistakes))
        options_defaults(world_table, &all);
    world->supersample = all.supersample;
    world->noise = all.noise;
    world->noise_seed = sample_hash((guint64)all.seed);
    world->warm_up_s = all.warm_up_s;
    world->warm_up_start = all.warm_up_start;
    world->drift = all.drift_pct / 100;
    world->drift_period_s = all.drift_period_s;
    world->wobble = RAD(all.wobble_deg);
    world->wobble_per_turn = all.wobble_per_turn;
    world->flicker = all.lamp_flicker;
    world->speckle_contrast = all.speckle_contrast;
    world->bleeding_share = all.bleeding_share;
    world->cache = cache_new((gsize)all.cache_mb << 20);
    struct sample_random random = device_random(&all, 'a', 0);
    struct optics_arc *arc = &world->arc;
    arc->zero = RAD(all.arc_zero_deg * sample_deviate(&random));
    struct v3 lean = deviate3(&random), aside = deviate3(&random);
    optics_arc_lean(arc, RAD(all.arc_tilt_deg * lean.x), RAD(all.arc_tilt_deg * lean.y));
    arc->centre_mm = v3(all.arc_mm * aside.x, all.arc_mm * aside.y, 0);
    arc->crooked = all.arc_tilt_deg > 0 || all.arc_mm > 0;
    world->arm = swing_of(&all, 'm', all.arm_axis_theta_deg, all.arm_axis_phi_deg, all.arm_zero_deg,
                          all.arm_tilt_deg, all.arm_mm);
    world->probe = swing_of(&all, 'p', all.probe_axis_theta_deg, all.probe_axis_phi_deg,
                            all.probe_zero_deg, all.probe_tilt_deg, all.probe_mm);
    gsize n = 0;
    const struct config_section *sections = config_sections(config, &n);
    gboolean all_sections = config_has_all_sections(config);
    for (gsize i = 0; i < n; i++)
        if (!sections[i].broken)
            all_sections &= load_section(world, &all, &sections[i], mistakes);
    load_sample(world, &all, config, all_sections, mistakes);
    return mistakes_report(mistakes, error);
}
