/* Effects of real rigs in the simulated world, each against a formula of its own. */
#include "lib/test.h"
#include "lib/world_fixture.h"
#include "world/truth.h"

#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))

/* A camera straight above: row y shows x = (y − 60)·(650 − z)/1000 mm, column x shows y. */
#define SIDE   121
#define PIXELS (SIDE * SIDE)
#define ABOVE                                                                                      \
    "theta_deg=0\nwidth=121\nheight=121\nfocal_px=1000\nbits=16\nblack_level=1000\n"               \
    "full_well_e=1e6\n"
#define MONO  "[camera above]\ncfa=mono\n" ABOVE
#define QUIET "[world]\nnoise=no\ngather_rays=0\n"
#define PLATE "[sample]\nkind=flat\nbase_mm=1\nalbedo=0.6\ngrid=4\nwidth_mm=90\nheight_mm=90\n"

static double above_mm(double pixel, double z) {
    return (pixel - 60) * (650 - z) / 1000;
}

static struct world_state lamp_state(double turntable_deg) {
    struct world_state state = {.turntable_deg = turntable_deg};
    state.lamp_output[0] = 1;
    for (int i = 0; i < WORLD_INSTANTS; i++)
        state.turning_deg[i] = turntable_deg;
    return state;
}

static struct world_state laser_state(double turntable_deg, double sweep_deg) {
    struct world_state state = lamp_state(turntable_deg);
    state.lamp_output[0] = 0;
    state.laser_on[0] = TRUE;
    state.sweep_deg[0] = sweep_deg;
    return state;
}

/* A picture of a world of this text, without its black level. */
static void picture_of(const char *text, const struct world_state *state, double exposure_s,
                       double *ret) {
    g_autoptr(World) world = world_fixture_new(text);
    g_autofree guint16 *pixels = g_new(guint16, PIXELS);
    world_expose(world, 0, state, (gint64)(exposure_s * 1e6), 0, 1, pixels);
    for (int i = 0; i < PIXELS; i++)
        ret[i] = pixels[i] - 1000.0;
}

/* Sum, mean and variance of the light along a column, in rows. */
static void column_moments(const double *picture, int column, double ret[3]) {
    double sum = 0, first = 0, second = 0;
    for (int y = 0; y < SIDE; y++) {
        const double value = picture[y * SIDE + column];
        sum += value;
        first += value * y;
        second += value * y * y;
    }
    ret[0] = sum;
    ret[1] = first / sum;
    ret[2] = second / sum - ret[1] * ret[1];
}

/* With all keys at 0 pictures are the same in every bit as without them. */
TEST(off) {
    static const char text[] = "[world]\n%s[camera a]\ntheta_deg=30\n%s[lamp l]\ntheta_deg=40\n"
                               "[laser s]\ntheta_deg=50\n%s[sample]\nkind=weave\n"
                               "width_mm=30\nheight_mm=30\n";
    static const char *const keys[2][3] = {
        {"", "", ""},
        {"bearing_wobble_deg=0\nlamp_flicker=0\nspeckle_contrast=0\nbleeding_share=0\n",
         "lateral_colour=0\nveiling_glare=0\nhalf_gain_step=0\ncolumn_offset=0\n",
         "sheet_bend_mm=0\n"}};
    static guint16 pictures[2][2][160 * 160];
    for (int given = 0; given < 2; given++) {
        const char *const *key = keys[given];
        g_autofree char *all = g_strdup_printf(text, key[0], key[1], key[2]);
        g_autoptr(World) world = world_fixture_new(all);
        world_set_lamp(world, 0, TRUE, 0);
        for (int laser = 0; laser < 2; laser++) {
            struct world_state state;
            world_set_turntable(world, 77);
            world_set_laser(world, 0, laser);
            world_snapshot(world, 20000000, 40000, &state);
            world_expose(world, 0, &state, 40000, 0, 5, pictures[given][laser]);
        }
    }
    g_assert_cmpmem(pictures[0], sizeof pictures[0], pictures[1], sizeof pictures[1]);
}

/* The line of a laser at θ from the zenith on a plate: b of the sheet moves it by b / cos θ. */
TEST(bent_sheet) {
    static const char sheet[] = QUIET MONO PLATE "[laser l]\ntheta_deg=50\nphi_deg=0\nwidth_mm=2\n";
    g_autofree char *bent = g_strconcat(sheet, "sheet_bend_mm=0.8\n", NULL);
    g_autofree double *was = g_new(double, PIXELS), *is = g_new(double, PIXELS);
    const struct world_state state = laser_state(0, 0);
    picture_of(sheet, &state, 0.5, was);
    picture_of(bent, &state, 0.5, is);
    for (int column = 4; column <= 116; column += 28) {
        double before[3], after[3];
        column_moments(was, column, before);
        column_moments(is, column, after);
        const double along = above_mm(column, 1) / 36;
        const double expected = -0.8 * along * along / cos(RAD(50));
        g_assert_cmpfloat_with_epsilon((after[1] - before[1]) * 0.649, expected, 0.03);
    }
    g_autoptr(World) world = world_fixture_new(bent);
    for (int k = -2; k <= 2; k++) {
        const double at[3] = {0, 18 * k, 0};
        /* The sheet must turn back by what it is ahead there. */
        const double expected = -0.8 * k * k / 4 / 480 * 180 / G_PI;
        g_assert_cmpfloat_with_epsilon(truth_laser_sweep_deg(world, 0, 33, at), expected, 1e-9);
    }
    struct truth_sheet plane;
    truth_laser_sheet(world, 0, 0, 1.5, &plane);
    const double x = (plane.offset_mm - plane.normal[2]) / plane.normal[0];
    g_assert_cmpfloat_with_epsilon(truth_laser_sweep_deg(world, 0, 0, (double[]){x, 0, 1}), 1.5,
                                   1e-9);
}

/* The turntable's axis, leaning by w to the azimuth of n times the turntable's angle. */
static void leaning(double w_deg, int n, double turn_deg, double ret[3]) {
    ret[0] = sin(RAD(w_deg)) * cos(n * RAD(turn_deg));
    ret[1] = sin(RAD(w_deg)) * sin(n * RAD(turn_deg));
    ret[2] = cos(RAD(w_deg));
}

#define WOBBLE QUIET "turntable_albedo=0\nbearing_wobble_deg=2\nbearing_wobble_per_turn=3\n"
#define FAR    "distance_mm=9000\nexponent=0\nintensity=4000\n"

TEST(wobble__truth) {
    g_autoptr(World) world = world_fixture_new(WOBBLE MONO PLATE "[lamp l]\ntheta_deg=40\n");
    for (double turn = 0; turn < 360; turn += 24) {
        double up[3], axis[3], there[3], back[3];
        leaning(2, 3, turn, up);
        truth_to_rig(world, turn, (double[]){0, 0, 7}, axis);
        for (int k = 0; k < 3; k++)
            g_assert_cmpfloat_with_epsilon(axis[k], 7 * up[k], 1e-9);
        truth_to_rig(world, turn, (double[]){30, 0, 0}, there);
        g_assert_cmpfloat_with_epsilon(there[0] * up[0] + there[1] * up[1] + there[2] * up[2], 0,
                                       1e-9);
        g_assert_cmpfloat_with_epsilon(hypot(hypot(there[0], there[1]), there[2]), 30, 1e-9);
        g_assert_cmpfloat_with_epsilon(
            remainder(atan2(there[1], there[0]) * 180 / G_PI - turn, 360), 0, 0.04);
        truth_view_centre_mm(world, 0, turn, there);
        truth_to_rig(world, turn, there, back);
        g_assert_cmpfloat_with_epsilon(hypot(back[0], back[1]), 0, 1e-9);
        g_assert_cmpfloat_with_epsilon(back[2], 650, 1e-9);
    }
    double lamp[3];
    truth_lamp(world, 0, 0, lamp, NULL); /* of the rig: the wobble does not move it */
    g_assert_cmpfloat_with_epsilon(lamp[0], 500 * sin(RAD(40)), 1e-9);
    g_assert_cmpfloat_with_epsilon(lamp[2], 500 * cos(RAD(40)), 1e-9);
}

/* A white disc moves in the picture as the truth says. */
TEST(wobble__view) {
    static const char rest[] = MONO "[lamp l]\ntheta_deg=20\n" FAR
                                    "[sample]\nkind=flat\nalbedo=0\nwidth_mm=2\nheight_mm=2\n"
                                    "[mark]\nx_mm=15\ny_mm=8\nz_mm=9\nradius_mm=4\n";
    g_autofree double *picture = g_new(double, PIXELS);
    for (double turn = 0; turn < 360; turn += 70) {
        double centre[2][2] = {0}, seen[2][2];
        for (int wobbles = 0; wobbles < 2; wobbles++) {
            g_autofree char *text =
                g_strconcat(wobbles ? WOBBLE : QUIET "turntable_albedo=0\n", rest, NULL);
            const struct world_state state = lamp_state(turn);
            double sum = 0, at[3];
            picture_of(text, &state, 0.1, picture);
            for (int i = 0; i < PIXELS; i++) {
                const int column = i % SIDE, row = i / SIDE;
                sum += picture[i];
                centre[wobbles][0] += picture[i] * column;
                centre[wobbles][1] += picture[i] * row;
            }
            centre[wobbles][0] /= sum;
            centre[wobbles][1] /= sum;
            g_autoptr(World) world = world_fixture_new(text);
            truth_to_rig(world, turn, (double[]){15, 8, 9}, at);
            truth_project(world, 0, at, seen[wobbles]);
        }
        g_assert_cmpfloat(hypot(seen[1][0] - seen[0][0], seen[1][1] - seen[0][1]), >, 0.2);
        for (int k = 0; k < 2; k++)
            g_assert_cmpfloat_with_epsilon(centre[1][k] - centre[0][k], seen[1][k] - seen[0][k],
                                           0.06);
    }
}

/* Lamps and lasers stay where they are while the plate leans: light by the cosine to its normal,
 * and the line where the sheet cuts it. */
TEST(wobble__light) {
    static const char *const lamps[] = {"", "phi_deg=70\n"};
    g_autofree double *level = g_new(double, PIXELS), *leans = g_new(double, PIXELS);
    for (int fixed = 0; fixed < 2; fixed++) {
        g_autofree char *rest =
            g_strconcat(MONO PLATE "[lamp l]\ntheta_deg=60\n" FAR, lamps[fixed], NULL);
        g_autofree char *without = g_strconcat(QUIET, rest, NULL);
        g_autofree char *with = g_strconcat(WOBBLE, rest, NULL);
        for (double turn = 10; turn < 360; turn += 50) {
            double up[3];
            struct world_state state = lamp_state(turn);
            state.arc_deg = 70;
            leaning(2, 3, turn, up);
            picture_of(without, &state, 0.2, level);
            picture_of(with, &state, 0.2, leans);
            const double aside = up[0] * cos(RAD(70)) + up[1] * sin(RAD(70));
            const double expected = (aside * sin(RAD(60)) + up[2] * cos(RAD(60))) / cos(RAD(60));
            g_assert_cmpfloat_with_epsilon(leans[60 * SIDE + 60] / level[60 * SIDE + 60], expected,
                                           1e-3);
        }
    }
    static const char line[] = WOBBLE MONO PLATE "[laser l]\ntheta_deg=45\nwidth_mm=2\n";
    for (double turn = 0; turn < 360; turn += 50) {
        double up[3], moments[3];
        const struct world_state state = laser_state(turn, 1.2);
        leaning(2, 3, turn, up);
        picture_of(line, &state, 0.5, leans);
        column_moments(leans, 60, moments);
        /* Where p = (480 sin 45°, 0, 480 cos 45°) − t (sin 46.2°, 0, cos 46.2°) has n·p = 1. */
        const double s = sin(RAD(46.2)), c = cos(RAD(46.2)), reach = 480 * sqrt(0.5);
        const double t = ((up[0] + up[2]) * reach - 1) / (up[0] * s + up[2] * c);
        const double x = reach - t * s, z = reach - t * c;
        g_assert_cmpfloat_with_epsilon(above_mm(moments[1], z), x, 0.06);
    }
}

#define SCENE                                                                                      \
    "[lamp l]\ntheta_deg=20\nintensity=20\n"                                                       \
    "[sample]\nkind=flat\nwidth_mm=30\nheight_mm=30\nalbedo=0.8;0.4;0.2\n"

static int filter_of(int i) { /* RGGB: 0 … 2 */
    return i / SIDE % 2 + i % SIDE % 2;
}

/* On a black surround every pixel gets the same share of the mean of its colour. */
TEST(glare) {
    static const char start[] = QUIET "turntable_albedo=0\n" SCENE "[camera above]\ncfa=rggb\n"
                                      "colour=1;0.7;0.5\n" ABOVE;
    g_autofree char *with = g_strconcat(start, "veiling_glare=0.03\n", NULL);
    g_autofree double *clean = g_new(double, PIXELS), *veiled = g_new(double, PIXELS);
    const struct world_state state = lamp_state(0);
    double mean[3] = {0};
    int n[3] = {0};
    picture_of(start, &state, 0.1, clean);
    picture_of(with, &state, 0.1, veiled);
    for (int i = 0; i < PIXELS; i++) {
        mean[filter_of(i)] += clean[i];
        n[filter_of(i)]++;
    }
    g_assert_cmpfloat(clean[0], ==, 0);
    g_assert_cmpfloat(mean[0] / n[0], >, 3 * mean[2] / n[2]);
    for (int i = 0; i < PIXELS; i++)
        g_assert_cmpfloat_with_epsilon(veiled[i] - clean[i],
                                       0.03 * mean[filter_of(i)] / n[filter_of(i)], 1.01);
}

/* The truth of what a camera shows of white has the step as well. */
TEST(halves__truth) {
    double white[2][2], xy[2][2];
    for (int on = 0; on < 2; on++) {
        g_autofree char *text =
            g_strconcat(QUIET MONO, on ? "half_gain_step=0.02\n" : "", SCENE, NULL);
        g_autoptr(World) world = world_fixture_new(text);
        for (int side = 0; side < 2; side++) {
            const double at[3] = {0, side ? 20 : -20, 0};
            truth_project(world, 0, at, xy[side]);
            white[on][side] = truth_white(world, 0, 0, 0, at, 1);
        }
    }
    g_assert_cmpfloat(xy[0][0], <, 60);
    g_assert_cmpfloat(xy[1][0], >, 61);
    g_assert_cmpfloat(white[1][0], ==, white[0][0]);
    g_assert_cmpfloat_with_epsilon(white[1][1] / white[0][1], 1.02, 1e-9);
}

TEST(halves_and_columns) {
    g_autofree double *plain = g_new(double, PIXELS), *seen = g_new(double, PIXELS);
    g_autofree double *dark = g_new(double, PIXELS);
    const struct world_state lit = lamp_state(0), unlit = {0};
    picture_of(QUIET MONO SCENE, &lit, 0.1, plain);
    picture_of(QUIET MONO "half_gain_step=0.02\n" SCENE, &unlit, 0.1, dark);
    picture_of(QUIET MONO "half_gain_step=0.02\n" SCENE, &lit, 0.1, seen);
    g_assert_cmpfloat(plain[60 * SIDE + 60], >, 5000);
    for (int i = 0; i < PIXELS; i++) { /* column 61 is the first of the right half of 121 */
        g_assert_cmpfloat(dark[i], ==, 0);
        g_assert_cmpfloat_with_epsilon(seen[i], plain[i] * (i % SIDE < 61 ? 1 : 1.02), 1.01);
    }
    picture_of(QUIET MONO "column_offset=0.001\n" SCENE, &unlit, 0.1, dark);
    picture_of(QUIET MONO "column_offset=0.001\n" SCENE, &lit, 0.1, seen);
    double sum = 0, squares = 0;
    for (int i = 0; i < PIXELS; i++) {
        g_assert_cmpfloat(dark[i], ==, dark[i % SIDE]);
        g_assert_cmpfloat_with_epsilon(seen[i] - plain[i], dark[i], 1.01);
        sum += dark[i] / PIXELS;
        squares += dark[i] * dark[i] / PIXELS;
    }
    /* 121 columns of 65.5 DN, within four standard errors. */
    g_assert_cmpfloat_with_epsilon(sqrt(squares - sum * sum) / 65.535, 1, 4 / sqrt(2 * 121));
    g_assert_cmpfloat_with_epsilon(sum / 65.535, 0, 4 / sqrt(121));
}

/* Middle of the light behind a filter, px. */
static void middle_of(const double *picture, int filter, double ret[2]) {
    double sum = 0;
    ret[0] = ret[1] = 0;
    for (int i = 0; i < PIXELS; i++) {
        if (filter_of(i) != filter)
            continue;
        const int column = i % SIDE, row = i / SIDE;
        sum += picture[i];
        ret[0] += picture[i] * column;
        ret[1] += picture[i] * row;
    }
    ret[0] /= sum;
    ret[1] /= sum;
}

TEST(lateral_colour) {
    static const char disc[] =
        QUIET "turntable_albedo=0\nsupersample=8\n[lamp l]\ntheta_deg=0\n"
              "[sample]\nkind=flat\nalbedo=0\nwidth_mm=2\nheight_mm=2\n[mark]\nx_mm=-22\ny_mm=17\n"
              "radius_mm=6\n[camera above]\ncfa=rggb\nblur_px=1.2\ncentre_px=9;-7\n" ABOVE;
    static const double weights[] = {1, 0, -1};
    g_autofree char *with = g_strconcat(disc, "lateral_colour=0.01\n", NULL);
    g_autofree double *was = g_new(double, PIXELS), *is = g_new(double, PIXELS);
    const struct world_state state = lamp_state(0);
    picture_of(disc, &state, 0.1, was);
    picture_of(with, &state, 0.1, is);
    for (int filter = 0; filter < 3; filter++) {
        double before[2], after[2];
        middle_of(was, filter, before);
        middle_of(is, filter, after);
        const double from[2] = {before[0] - 69, before[1] - 53};
        g_assert_cmpfloat(fabs(from[0]) + fabs(from[1]), >, 50);
        for (int k = 0; k < 2; k++)
            g_assert_cmpfloat_with_epsilon(after[k] - before[k], 0.01 * weights[filter] * from[k],
                                           0.03);
    }
    /* A laser has one colour: all pixels see it equally displaced, one between red and green by the
     * mean of both, one without a colour not at all. */
    static const char line[] =
        QUIET MONO "%s" PLATE "[laser l]\ntheta_deg=45\nwidth_mm=2\ncolour=%s\n";
    static const char *const colours[] = {"1;1;0", "1;1;1"};
    for (int k = 0; k < 2; k++) {
        double before[3], after[3];
        const struct world_state swept = laser_state(0, -1.5);
        for (int on = 0; on < 2; on++) {
            g_autofree char *text =
                g_strdup_printf(line, on ? "lateral_colour=0.01\n" : "", colours[k]);
            picture_of(text, &swept, 0.5, is);
            column_moments(is, 60, on ? after : before);
        }
        g_assert_cmpfloat(before[1] - 60, >, 20);
        g_assert_cmpfloat_with_epsilon(after[1] - before[1], (k ? 0 : 0.005) * (before[1] - 60),
                                       0.02);
    }
}

/* Ratios of a picture with speckle to one without, where the line is bright; less their mean. */
struct ratios {
    double value[PIXELS], mean, contrast;
    gboolean bright[PIXELS];
};

static struct ratios *ratios_of(const char *contrast, double sweep_deg) {
    struct ratios *ratios = g_new0(struct ratios, 1);
    g_autofree double *even = g_new(double, PIXELS), *rough = g_new(double, PIXELS);
    const struct world_state state = laser_state(0, sweep_deg);
    for (int k = 0; k < 2; k++) {
        g_autofree char *text = g_strconcat(QUIET, "speckle_contrast=", k ? contrast : "0",
                                            "\n" MONO "blur_px=1\n" PLATE
                                            "[laser l]\ntheta_deg=30\nwidth_mm=20\npower_w=0.3\n",
                                            NULL);
        picture_of(text, &state, 0.5, k ? rough : even);
    }
    double sum = 0, squares = 0;
    int n = 0;
    for (int i = 0; i < PIXELS; i++) {
        ratios->bright[i] = even[i] > 1000;
        if (!ratios->bright[i])
            continue;
        ratios->value[i] = rough[i] / even[i];
        sum += ratios->value[i];
        squares += ratios->value[i] * ratios->value[i];
        n++;
    }
    g_assert_cmpint(n, >, 3000);
    ratios->mean = sum / n;
    ratios->contrast = sqrt(squares / n - ratios->mean * ratios->mean);
    return ratios;
}

/* Of the ratios of a with those of b, so many columns to the right. */
static double correlation(const struct ratios *a, const struct ratios *b, int right) {
    double sum = 0;
    int n = 0;
    for (int i = 0; i + right < PIXELS; i++)
        if (i % SIDE + right < SIDE && a->bright[i] && b->bright[i + right]) {
            sum += (a->value[i] - a->mean) * (b->value[i + right] - b->mean);
            n++;
        }
    return sum / n / (a->contrast * b->contrast);
}

/* A grain covers about 4 π σ² = 13 pixels, so that 5000 pixels hold 400 of them. */
TEST(speckle) {
    g_autofree struct ratios *first = ratios_of("0.3", 0), *next = ratios_of("0.3", 0.01);
    g_autofree struct ratios *again = ratios_of("0.3", 0), *strong = ratios_of("0.9", 0);
    g_assert_cmpfloat_with_epsilon(first->mean, 1, 4 * 0.3 / sqrt(400));
    g_assert_cmpfloat_with_epsilon(first->contrast / 0.3, 1, 4 / sqrt(2 * 400));
    g_assert_cmpfloat_with_epsilon(strong->contrast / 0.9, 1, 6 / sqrt(2 * 400));
    g_assert_cmpfloat_with_epsilon(correlation(first, first, 1), exp(-1.0 / 4), 0.08);
    g_assert_cmpfloat_with_epsilon(correlation(first, first, 2), exp(-4.0 / 4), 0.12);
    g_assert_cmpfloat_with_epsilon(correlation(first, first, 8), 0, 0.2);
    g_assert_cmpfloat_with_epsilon(correlation(first, next, 0), 0, 0.2);
    g_assert_cmpmem(first, sizeof *first, again, sizeof *again);
}

/* The line keeps its light, and its variance grows by that of exp(−r/scale), r < 5 scales:
 * ½ ∫ r³ exp(−r) / ∫ r exp(−r) = 2.298 scales². */
TEST(bleeding) {
    static const char line[] = "[laser l]\ntheta_deg=45\nwidth_mm=2\n";
    g_autofree double *was = g_new(double, PIXELS), *is = g_new(double, PIXELS);
    const struct world_state state = laser_state(0, 0.4);
    g_autofree char *before = g_strconcat(QUIET MONO PLATE, line, NULL);
    g_autofree char *after =
        g_strconcat(QUIET "bleeding_share=0.3\nbleeding_mm=1.5\n" MONO PLATE, line, NULL);
    double sharp[3], wide[3];
    picture_of(before, &state, 0.5, was);
    picture_of(after, &state, 0.5, is);
    column_moments(was, 60, sharp);
    column_moments(is, 60, wide);
    g_assert_cmpfloat_with_epsilon(wide[0] / sharp[0], 1, 0.01);
    g_assert_cmpfloat_with_epsilon(wide[1] - sharp[1], 0, 0.03);
    g_assert_cmpfloat_with_epsilon((wide[2] - sharp[2]) * 0.649 * 0.649, 0.3 * 2.298 * 1.5 * 1.5,
                                   0.05);
}

/* Light that comes from a line at a distance, in scales of 0.6 mm; without a factor. */
static double from_line(double x_mm, double z_mm) {
    double sum = 0;
    for (double y = -3; y <= 3; y += 0.01) {
        const double r = sqrt(x_mm * x_mm + y * y + z_mm * z_mm) / 0.6;
        sum += r < 5 ? exp(-r) : 0;
    }
    return sum;
}

/* Light that enters a block near its edge goes through the material to a lower block next to it;
 * it does not come out of the turntable. */
TEST(bleeding_at_a_step) {
    g_autofree double *was = g_new(double, PIXELS), *is = g_new(double, PIXELS);
    double out[2], expected[2] = {0};
    for (int step = 0; step < 2; step++) {
        g_autoptr(GString) obj = g_string_new(NULL);
        world_fixture_box(obj, 0, -15, 0, -25, 25, 4.5);
        world_fixture_box(obj, 8, 0, 15, -25, 25, step ? 3 : 4.5);
        g_autofree char *path = world_fixture_write("step.obj", obj->str);
        static const char rest[] = MONO "[laser l]\ntheta_deg=0\nwidth_mm=0.4\npower_w=0.003\n"
                                        "[sample]\nkind=obj\npath=step.obj\n";
        g_autofree char *with =
            g_strconcat(QUIET "turntable_albedo=0.5\nbleeding_share=0.5\n", rest, NULL);
        g_autofree char *without = g_strconcat(QUIET "turntable_albedo=0.5\n", rest, NULL);
        const double beside[3] = {-0.6, 0, 4.5}, table[3] = {18, 0, 0};
        World *world = world_fixture_new(with); /* one world has this path at a time */
        const struct world_state state = laser_state(0, truth_laser_sweep_deg(world, 0, 0, beside));
        const struct world_state away = laser_state(0, truth_laser_sweep_deg(world, 0, 0, table));
        world_unref(world);
        picture_of(without, &state, 0.5, was);
        picture_of(with, &state, 0.5, is);
        out[step] = 0;
        for (int y = 60; y < SIDE; y++) {
            const double x = above_mm(y, step ? 3 : 4.5);
            if (!(x > 0.5 && x < 1.7))
                continue;
            out[step] += is[y * SIDE + 60] - was[y * SIDE + 60];
            for (int part = -4; part <= 4; part++) /* of the pixel */
                expected[step] += from_line(x + part * 0.072 + 0.6, step ? 1.5 : 0);
        }
        g_assert_cmpfloat_with_epsilon(is[59 * SIDE + 60] / was[59 * SIDE + 60], 0.65, 0.15);
        picture_of(without, &away, 0.5, was);
        picture_of(with, &away, 0.5, is);
        g_assert_cmpfloat(was[88 * SIDE + 60], >, 100);
        g_assert_cmpmem(is, sizeof(double) * PIXELS, was, sizeof(double) * PIXELS);
    }
    g_test_message("beyond the edge %.4g DN, over a step %.4g DN: ratio expected %.3f", out[0],
                   out[1], expected[1] / expected[0]);
    g_assert_cmpfloat(out[0], >, 100);
    g_assert_cmpfloat_with_epsilon(out[1] / out[0] / (expected[1] / expected[0]), 1, 0.1);
}

/* Standard deviation over many frames, mean 1; each lamp and each time on its own. */
TEST(flicker) {
    enum { FRAMES = 4000 };
    g_autoptr(World) world = world_fixture_new(
        "[world]\nlamp_flicker=0.02\nwarm_up_s=0\n[camera c]\ntheta_deg=0\n[lamp a]\n"
        "theta_deg=10\n[lamp b]\ntheta_deg=20\n[sample]\nkind=flat\n");
    struct world_state state, again;
    double sum[2] = {0}, squares[2] = {0}, both = 0, follow = 0, last = 0;
    world_set_lamp(world, 0, TRUE, 0);
    world_set_lamp(world, 1, TRUE, 0);
    for (int i = 0; i < FRAMES; i++) {
        world_snapshot(world, 1000000 + 50000 * i, 20000, &state);
        const double off[2] = {(double)state.lamp_output[0] - 1, (double)state.lamp_output[1] - 1};
        for (int k = 0; k < 2; k++) {
            sum[k] += off[k] / FRAMES;
            squares[k] += off[k] * off[k] / FRAMES;
        }
        both += off[0] * off[1] / FRAMES;
        follow += off[0] * last / FRAMES;
        last = off[0];
    }
    const double error = 1 / sqrt(FRAMES);
    for (int k = 0; k < 2; k++) {
        g_assert_cmpfloat_with_epsilon(sum[k], 0, 4 * 0.02 * error);
        g_assert_cmpfloat_with_epsilon(sqrt(squares[k]) / 0.02, 1, 4 * error / G_SQRT2);
    }
    g_assert_cmpfloat_with_epsilon(both / 4e-4, 0, 4 * error);
    g_assert_cmpfloat_with_epsilon(follow / 4e-4, 0, 4 * error);
    world_snapshot(world, 1000000 + 50000 * (FRAMES - 1), 20000, &again);
    g_assert_cmpfloat(again.lamp_output[0], ==, state.lamp_output[0]);
}

AFTER_TESTS {
    world_fixture_clean();
}
