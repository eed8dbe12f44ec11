#include "lib/test.h"
#include "mdf/mdf.h"
#include "mdf/mdf_merge.h"
#include "mdf/mdf_table.h"

#include "frames/rectify.h"
#include "lib/analytic.h"

#include <math.h>

#define DEGREE   (G_PI / 180)
#define SIDE     128
#define N_TEXELS (20 * 20)
#define FROM_DEG -6.0
#define STEP_DEG 0.12
#define N_STEPS  100

static const struct session_grid grid = {20, 20, 30, 30, 5, 5};

/* The surface in the sample frame: z = height + slope·(x, y), and step_mm more where x > edge,
 * which winds by tooth_mm to both sides, every TOOTH_MM. */
struct surface {
    double height, slope_x, slope_y, step_mm, edge_mm, tooth_mm;
};

#define TOOTH_MM 1.6

static double edge_at(const struct surface *surface, double y) {
    return surface->edge_mm + surface->tooth_mm * sin(2 * G_PI * y / TOOTH_MM);
}

/* The camera over azimuth 0 with the sample turned: where a ray meets the surface, as distance. */
static double meet(const struct surface *surface, const double *eye, const double *ray) {
    for (int raised = 1; raised >= 0; raised--) {
        double height = surface->height + (raised ? surface->step_mm : 0);
        double n[3] = {-surface->slope_x, -surface->slope_y, 1};
        double t = (height - analytic_dot(n, eye)) / analytic_dot(n, ray), x = eye[0] + t * ray[0];
        if (!raised || (surface->step_mm > 0 && x > edge_at(surface, eye[1] + t * ray[1])))
            return t;
    }
    g_assert_not_reached();
}

struct world {
    struct pinhole pinhole;
    struct surface surface;
    double turntable;
    double scale; /* of rig and texels: 1 is 1.5 mm a texel */
    float peak[SIDE * SIDE], width[SIDE * SIDE], intensity[SIDE * SIDE];
};

static double meet_turned(const struct world *world, const double *ray) {
    double eye[3], sample_eye[3], sample_ray[3];
    pinhole_eye(&world->pinhole, eye);
    analytic_turn(eye, -world->turntable, sample_eye);
    analytic_turn(ray, -world->turntable, sample_ray);
    return meet(&world->surface, sample_eye, sample_ray);
}

/* What a sweep leaves in each pixel. */
static void sweep(struct world *world, const struct line_laser *laser, double arc, double noise,
                  GRand *random) {
    double eye[3], ray[3];
    pinhole_eye(&world->pinhole, eye);
    for (int i = 0; i < SIDE * SIDE; i++) {
        pinhole_ray(&world->pinhole, i % SIDE, (double)(i / SIDE), ray);
        double t = meet_turned(world, ray);
        double point[3] = {eye[0] + t * ray[0], eye[1] + t * ray[1], eye[2] + t * ray[2]};
        double peak = (line_laser_sweep(laser, arc, point) / DEGREE - FROM_DEG) / STEP_DEG;
        if (noise > 0)
            peak += noise * (g_rand_double(random) + g_rand_double(random) - 1) * 2.45;
        world->peak[i] = peak > 0 && peak < N_STEPS - 1 ? (float)peak : -1;
        world->width[i] = 1.5f;
        world->intensity[i] = 1000;
    }
}

static void add(MdfView *view, const struct world *world, const struct line_laser *laser,
                double arc) {
    struct rig_laser rig = line_laser_to_rig(laser, "laser");
    struct laser_sweep seen = {&rig,        arc,          FROM_DEG * DEGREE, STEP_DEG * DEGREE,
                               world->peak, world->width, world->intensity,  NULL};
    mdf_view_add(view, &seen);
}

/* The distance from the reference plane along the ray through a texel's centre. */
static double expected_mm(const struct world *world, int texel) {
    double p[3] = {-15 + (texel % 20 + 0.5) * 1.5, 15 - ((double)(texel / 20) + 0.5) * 1.5, 5};
    double eye[3], ray[3];
    for (int i = 0; i < 3; i++)
        p[i] *= world->scale;
    analytic_turn(p, world->turntable, p);
    pinhole_eye(&world->pinhole, eye);
    double length = sqrt(pow(p[0] - eye[0], 2) + pow(p[1] - eye[1], 2) + pow(p[2] - eye[2], 2));
    for (int i = 0; i < 3; i++)
        ray[i] = (p[i] - eye[i]) / length;
    return meet_turned(world, ray) - length;
}

/* Straight lasers at these elevations, all around. */
static void add_all(MdfView *view, struct world *world, double noise) {
    GRand *random = g_rand_new_with_seed(5);
    for (int i = 0; i < 12; i++) {
        struct line_laser laser = {(15 + 15 * (i % 5)) * DEGREE, 480 * world->scale};
        double arc = (15 + 37 * i) * DEGREE;
        sweep(world, &laser, arc, noise, random);
        add(view, world, &laser, arc);
    }
    g_rand_free(random);
}

struct errors {
    double rms, worst;
    int missing, most;
};

static struct errors measure(struct world *world, double noise) {
    struct rig_camera camera = pinhole_to_rig(&world->pinhole, "cam");
    struct session_grid scaled = grid;
    scaled.width_mm *= world->scale;
    scaled.height_mm *= world->scale;
    scaled.reference_mm *= world->scale;
    scaled.depth_mm *= world->scale;
    g_autoptr(MdfView) view = mdf_view_new(&camera, world->turntable, &scaled);
    add_all(view, world, noise);
    float mm[N_TEXELS], n[N_TEXELS], s[N_TEXELS];
    mdf_view_merge(view, mm, n, s);
    struct errors errors = {0};
    for (int i = 0; i < N_TEXELS; i++) {
        g_assert_true(isfinite(mm[i]) && isfinite(n[i]) && isfinite(s[i]));
        if (mm[i] < 0) {
            g_assert_cmpfloat(n[i], ==, 0);
            errors.missing++;
            continue;
        }
        double error = mm[i] - expected_mm(world, i);
        errors.rms += error * error;
        errors.worst = MAX(errors.worst, fabs(error));
        errors.most = MAX(errors.most, (int)n[i]);
    }
    errors.rms = sqrt(errors.rms / MAX(1, N_TEXELS - errors.missing));
    return errors;
}

static struct world *new_world(double theta_deg, double turntable_deg, struct surface surface) {
    struct world *world = g_new0(struct world, 1);
    world->pinhole = (struct pinhole){SIDE, SIDE, theta_deg * DEGREE, 650, 1600};
    world->turntable = turntable_deg * DEGREE;
    world->surface = surface;
    world->scale = 1;
    return world;
}

/* A plane below the reference plane, level and tilted, in views from steep to grazing. */
TEST(planes) {
    static const struct surface planes[] = {{3, 0, 0}, {1.5, 0, 0}, {2.5, 0.08, -0.05}};
    for (guint p = 0; p < G_N_ELEMENTS(planes); p++)
        for (int view = 0; view < 10; view++) {
            g_autofree struct world *world = new_world(15 + 15 * (view % 5), 67 * view, planes[p]);
            struct errors errors = measure(world, 0);
            g_test_message("plane %u view %d: missing %d, worst %.4f mm", p, view, errors.missing,
                           errors.worst);
            g_assert_cmpint(errors.missing, ==, 0);
            g_assert_cmpfloat(errors.worst, <, 0.01);
            g_assert_cmpint(errors.most, >, 4);
        }
}

/* A tenth of a frame is about 0.1 mm of one laser; the mean of several is better. */
TEST(noise) {
    g_autofree struct world *world = new_world(45, 20, (struct surface){2, 0, 0});
    struct errors errors = measure(world, 0.1);
    g_test_message("RMS %.4f mm", errors.rms);
    g_assert_cmpint(errors.missing, ==, 0);
    g_assert_cmpfloat(errors.rms, <, 0.05);
}

struct merged {
    float mm[N_TEXELS], n[N_TEXELS], s[N_TEXELS];
};

/* Error bars are right when twelve, five or two lasers have seen a plane: the mean of
 * ((mm − truth) / s)² is 1. By the scatter of two alone it would be infinite. (With a tenth of a
 * frame of noise, two disagree too often, and pairs that agree by chance are left.) */
TEST(error_bars) {
    enum { DRAWS = 6 };
    static const struct {
        int lasers, from;
        double noise; /* frames */
    } cases[] = {{12, 0, 0.1}, {5, 3, 0.1}, {2, 1, 0.03}};
    struct merged m;
    for (guint c = 0; c < G_N_ELEMENTS(cases); c++) {
        g_autofree struct world *world = new_world(30, 20, (struct surface){2, 0.05, 0});
        struct rig_camera camera = pinhole_to_rig(&world->pinhole, "cam");
        double squares = 0;
        int n = 0;
        for (guint32 draw = 0; draw < DRAWS; draw++) {
            g_autoptr(MdfView) view = mdf_view_new(&camera, world->turntable, &grid);
            g_autoptr(GRand) random = g_rand_new_with_seed(draw);
            for (int i = cases[c].from; i < cases[c].from + cases[c].lasers; i++) {
                struct line_laser laser = {(15 + 15 * (i % 5)) * DEGREE, 480};
                sweep(world, &laser, (15 + 37 * i) * DEGREE, cases[c].noise, random);
                add(view, world, &laser, (15 + 37 * i) * DEGREE);
            }
            mdf_view_merge(view, m.mm, m.n, m.s);
            for (int i = 0; i < N_TEXELS; i++) {
                if (m.n[i] < 2)
                    continue;
                squares += pow((m.mm[i] - expected_mm(world, i)) / (double)m.s[i], 2);
                n++;
            }
        }
        g_test_message("%d lasers: χ² %.3f over %d texels", cases[c].lasers, squares / n, n);
        g_assert_cmpint(n, >, DRAWS * N_TEXELS * 9 / 10);
        g_assert_cmpfloat(squares / n, >, 0.8);
        g_assert_cmpfloat(squares / n, <, 1.25);
    }
}

/* Rig, texels and a surface with a step, whose upper part rises above the reference plane, at half
 * and at ten times the size: as many texels are measured, and their errors have grown as much. */
TEST(scale) {
    static const double scales[] = {1, 0.5, 10};
    struct errors first = {0};
    for (guint i = 0; i < G_N_ELEMENTS(scales); i++) {
        const double scale = scales[i];
        const struct surface surface = {3.5 * scale, 0.02, 0.01, 1.5 * scale, 0.2 * scale};
        g_autofree struct world *world = new_world(30, 20, surface);
        world->scale = scale;
        world->pinhole.distance_mm *= scale;
        const struct errors errors = measure(world, 0.1);
        if (i == 0)
            first = errors;
        g_test_message("scale %g: %d missing, RMS %.5f, worst %.4f, by up to %d", scale,
                       errors.missing, errors.rms / scale, errors.worst / scale, errors.most);
        g_assert_cmpint(errors.missing, ==, first.missing);
        g_assert_cmpint(errors.most, ==, first.most);
        g_assert_cmpfloat_with_epsilon(errors.rms / scale, first.rms, 1e-3 * first.rms);
    }
    g_assert_cmpint(first.missing, <, N_TEXELS / 50);
}

/* Elevations from theta_deg in steps of 5° (three of them) or none, azimuths in steps of
 * arc_step_deg. */
struct lasers {
    int n;
    double theta_deg, theta_step_deg, arc_deg, arc_step_deg;
};
static const struct lasers nine = {9, 30, 5, 70, 30}, five = {5, 45, 0, 75, 50};

/* Merges sweeps of these lasers; before and after (may be NULL) change the world before each sweep
 * and what it leaves. */
static struct merged *merge(struct world *world, const struct lasers *lasers,
                            void (*before)(struct world *world, int laser),
                            void (*after)(struct world *world, int laser)) {
    struct rig_camera camera = pinhole_to_rig(&world->pinhole, "cam");
    g_autoptr(MdfView) view = mdf_view_new(&camera, world->turntable, &grid);
    struct merged *merged = g_new(struct merged, 1);
    for (int i = 0; i < lasers->n; i++) {
        struct line_laser laser = {(lasers->theta_deg + lasers->theta_step_deg * (i % 3)) * DEGREE,
                                   480};
        double arc = (lasers->arc_deg + lasers->arc_step_deg * i) * DEGREE;
        if (before)
            before(world, i);
        sweep(world, &laser, arc, 0, NULL);
        if (after)
            after(world, i);
        add(view, world, &laser, arc);
    }
    mdf_view_merge(view, merged->mm, merged->n, merged->s);
    return merged;
}

static void assert_surface(const struct world *world, const struct merged *merged, double most) {
    for (int i = 0; i < N_TEXELS; i++)
        g_assert_cmpfloat_with_epsilon(merged->mm[i], expected_mm(world, i), most);
}

/* At a step each texel shows one side or the other, never the middle. */
TEST(step) {
    struct surface step = {1, 0, 0, 3, 0.2};
    g_autofree struct world *world = new_world(30, 0, step);
    struct rig_camera camera = pinhole_to_rig(&world->pinhole, "cam");
    g_autoptr(MdfView) view = mdf_view_new(&camera, world->turntable, &grid);
    add_all(view, world, 0);
    float mm[N_TEXELS], n[N_TEXELS], s[N_TEXELS];
    mdf_view_merge(view, mm, n, s);
    int wrong = 0;
    for (int i = 0; i < N_TEXELS; i++) {
        double high = 1 / cos(30 * DEGREE), low = 4 / cos(30 * DEGREE);
        double to_either = MIN(fabs(mm[i] - high), fabs(mm[i] - low));
        g_assert_cmpfloat(to_either, <, 0.25); /* rays are not all at 30° */
        wrong += fabs(mm[i] - expected_mm(world, i)) > 0.2;
    }
    g_assert_cmpint(wrong, <=, 20); /* one texel a row, at the edge */
}

/* Beside a step, on ground that no laser reaches: hardly a texel takes the height of the step,
 * which some of the pixels around it see. */
TEST(beside_step) {
    enum { EDGES = 15 };
    static struct merged m;
    int wrong = 0;
    for (int e = 0; e < EDGES; e++) {
        g_autofree struct world *world = new_world(5, 20, (struct surface){1, 0, 0, 3, 0.1 * e});
        struct rig_camera camera = pinhole_to_rig(&world->pinhole, "cam");
        g_autoptr(MdfView) view = mdf_view_new(&camera, world->turntable, &grid);
        double ray[3];
        for (int i = 0; i < 6; i++) {
            struct line_laser laser = {(15 + 15 * (i % 5)) * DEGREE, 480};
            sweep(world, &laser, 60 * i * DEGREE, 0, NULL);
            for (int k = 0; k < SIDE * SIDE; k++) {
                double eye[3];
                pinhole_eye(&world->pinhole, eye);
                pinhole_ray(&world->pinhole, k % SIDE, (double)(k / SIDE), ray);
                if (eye[2] + ray[2] * meet_turned(world, ray) < 2)
                    world->peak[k] = -1;
            }
            add(view, world, &laser, 60 * i * DEGREE);
        }
        mdf_view_merge(view, m.mm, m.n, m.s);
        for (int i = 0; i < N_TEXELS; i++)
            wrong += m.mm[i] >= 0 && expected_mm(world, i) > 2.5;
    }
    g_test_message("%d wrong along %d steps of 20 texels", wrong, EDGES);
    g_assert_cmpint(wrong, <=, 2);
}

/* Along the foot of a step with teeth as wide as a texel, no laser reaches the ground. Texels
 * there whose pixels see the step's top are off by its height, and their error bars hold it. */
TEST(hidden_foot) {
    enum { EDGES = 8, LASERS = 8, FOOT_MM = 1 };
    static struct merged m;
    double squares = 0;
    int wrong = 0, n = 0;
    for (int e = 0; e < EDGES; e++) {
        g_autofree struct world *world = new_world(5, 0, (struct surface){1, 0, 0, 3, 0.19 * e, 1});
        struct rig_camera camera = pinhole_to_rig(&world->pinhole, "cam");
        g_autoptr(MdfView) view = mdf_view_new(&camera, world->turntable, &grid);
        g_autoptr(GRand) random = g_rand_new_with_seed((guint32)e);
        double eye[3], ray[3];
        pinhole_eye(&world->pinhole, eye);
        for (int i = 0; i < LASERS; i++) {
            struct line_laser laser = {(15 + 15 * (i % 5)) * DEGREE, 480};
            sweep(world, &laser, (20 + 45 * i) * DEGREE, 0.1, random);
            for (int k = 0; k < SIDE * SIDE; k++) {
                pinhole_ray(&world->pinhole, k % SIDE, (double)(k / SIDE), ray);
                const double t = meet_turned(world, ray);
                if (eye[2] + t * ray[2] < 2 &&
                    eye[0] + t * ray[0] > world->surface.edge_mm - FOOT_MM)
                    world->peak[k] = -1;
            }
            add(view, world, &laser, (20 + 45 * i) * DEGREE);
        }
        mdf_view_merge(view, m.mm, m.n, m.s);
        for (int i = 0; i < N_TEXELS; i++) {
            const double off_mm = m.mm[i] - expected_mm(world, i);
            if (m.n[i] < 2 || fabs(-15 + (i % 20 + 0.5) * 1.5 - world->surface.edge_mm) > 1.5)
                continue;
            squares += pow(off_mm / (double)m.s[i], 2);
            wrong += fabs(off_mm) > 1;
            n++;
        }
    }
    g_test_message("%d of %d texels at the edge wrong, chi-square %.3f", wrong, n, squares / n);
    g_assert_cmpint(wrong, >, 3);
    g_assert_cmpfloat(squares / n, <, 2);
    g_assert_cmpfloat(squares / n, >, 0.1);
}

static void reflect_a_third(struct world *world, int i) {
    world->surface.height = i % 3 == 1 ? 0.3 + 0.2 * i : 2;
}

/* Some lasers see a reflection instead: they are outvoted, not averaged. */
TEST(outliers) {
    g_autofree struct world *world = new_world(45, 100, (struct surface){2, 0, 0});
    g_autofree struct merged *merged = merge(world, &nine, reflect_a_third, NULL);
    world->surface.height = 2;
    assert_surface(world, merged, 0.05);
}

/* What is in the files of some damaged sweeps, instead of peaks, widths or intensities. */
static void spoil_a_third(struct world *world, int laser) {
    const float nothing[] = {NAN, INFINITY, -INFINITY, 1e30F};
    float *const planes[] = {world->peak, world->width, world->intensity};
    for (int i = 0; i < SIDE * SIDE && laser % 3 == 1; i++)
        planes[laser / 3][i] = nothing[i % 4];
}

/* Some sweeps are of values that are not numbers, or of impossible ones: the others tell. */
TEST(not_numbers) {
    g_autofree struct world *world = new_world(45, 100, (struct surface){2, 0, 0});
    g_autofree struct merged *merged = merge(world, &nine, NULL, spoil_a_third);
    for (int i = 0; i < N_TEXELS; i++)
        g_assert_true(isfinite(merged->n[i]) && isfinite(merged->s[i]));
    assert_surface(world, merged, 0.05);
}

static void raise_most(struct world *world, int i) {
    world->surface.height = i < 6 ? 2.6 : 2;
}

static void dim_most(struct world *world, int i) {
    for (int k = 0; k < SIDE * SIDE; k++)
        world->intensity[k] = i < 5 ? 30 : i == 5 ? (k % 2 ? NAN : -INFINITY) : 900;
}

/* Most lasers do not reach a place and see what others throw back there, faintly and elsewhere: the
 * few that are bright are believed. Brightness that is not a number counts for nothing. */
TEST(faint) {
    g_autofree struct world *world = new_world(45, 100, (struct surface){2, 0, 0});
    g_autofree struct merged *merged = merge(world, &nine, raise_most, dim_most);
    world->surface.height = 2;
    assert_surface(world, merged, 0.05);
}

/* A ghost of each laser is brighter than its line, at a place of its own: second pulses, which
 * agree, are believed. */
TEST(ghosts) {
    g_autofree struct world *world = new_world(45, 100, (struct surface){2, 0, 0});
    g_autofree struct world *ghost = new_world(45, 100, (struct surface){2, 0, 0});
    struct rig_camera camera = pinhole_to_rig(&world->pinhole, "cam");
    g_autoptr(MdfView) view = mdf_view_new(&camera, world->turntable, &grid);
    for (int i = 0; i < 9; i++) {
        struct line_laser laser = {(30 + 5 * (i % 3)) * DEGREE, 480};
        struct rig_laser rig = line_laser_to_rig(&laser, "laser");
        double arc = (70 + 30 * i) * DEGREE;
        ghost->surface.height = 0.2 + 0.45 * i;
        sweep(world, &laser, arc, 0, NULL);
        sweep(ghost, &laser, arc, 0, NULL);
        for (int k = 0; k < SIDE * SIDE; k++)
            world->intensity[k] = 700;
        struct laser_sweep seen = {.laser = &rig,
                                   .arc_rad = arc,
                                   .from_rad = FROM_DEG * DEGREE,
                                   .step_rad = STEP_DEG * DEGREE,
                                   .peak = ghost->peak,
                                   .width = ghost->width,
                                   .intensity = ghost->intensity,
                                   .second_peak = world->peak,
                                   .second_intensity = world->intensity};
        mdf_view_add(view, &seen);
    }
    struct merged merged;
    mdf_view_merge(view, merged.mm, merged.n, merged.s);
    assert_surface(world, &merged, 0.05);
    for (int i = 0; i < N_TEXELS; i++)
        g_assert_cmpfloat(merged.n[i], >=, 6);
}

static void hide_strip_of_others(struct world *world, int laser) {
    for (int i = 0; i < SIDE * SIDE && laser > 0; i++)
        if (i % SIDE >= SIDE / 2 && i % SIDE < SIDE / 2 + 4)
            world->peak[i] = -1;
}

/* Seen by one laser only, but the surface around goes on there: believed, and said to be one. */
TEST(continued) {
    g_autofree struct world *world = new_world(45, 30, (struct surface){2, 0, 0});
    g_autofree struct merged *merged = merge(world, &five, NULL, hide_strip_of_others);
    int alone = 0;
    for (int i = 0; i < N_TEXELS; i++) {
        if (merged->n[i] == 0)
            continue;
        g_assert_cmpfloat_with_epsilon(merged->mm[i], expected_mm(world, i), 0.05);
        alone += merged->n[i] == 1;
        g_assert_true(merged->s[i] > 0 && merged->s[i] < 1.5);
    }
    g_assert_cmpint(alone, >, 0);
}

TEST(unseen) {
    g_autofree struct world *world = new_world(45, 100, (struct surface){2, 0, 0});
    struct rig_camera camera = pinhole_to_rig(&world->pinhole, "cam");
    float mm[N_TEXELS], n[N_TEXELS], s[N_TEXELS];
    g_autoptr(MdfView) none = mdf_view_new(&camera, world->turntable, &grid);
    mdf_view_merge(none, mm, n, s);
    for (int i = 0; i < N_TEXELS; i++)
        g_assert_true(mm[i] == -1 && n[i] == 0 && s[i] == -1);

    g_autoptr(MdfView) view = mdf_view_new(&camera, world->turntable, &grid);
    struct line_laser laser = {30 * DEGREE, 480};
    sweep(world, &laser, 2, 0, NULL);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) /* what is left of the middle is not a time at all */
            if (x < SIDE / 2)
                world->peak[SIDE * y + x] = y % 3 == 0 ? NAN : y % 3 == 1 ? -1 : INFINITY;
    add(view, world, &laser, 2);
    mdf_view_merge(view, mm, n, s);
    int seen = 0;
    for (int i = 0; i < N_TEXELS; i++) {
        g_assert_true(mm[i] == -1 || fabs(mm[i] - expected_mm(world, i)) < 0.01);
        g_assert_true(mm[i] >= 0 ? s[i] > 0 : s[i] == -1);
        seen += mm[i] >= 0;
    }
    g_assert_cmpint(seen, >, N_TEXELS * 2 / 5);
    g_assert_cmpint(seen, <, N_TEXELS * 3 / 5);
}

static void keep_one_phase(struct world *world, int laser G_GNUC_UNUSED) {
    for (int i = 0; i < SIDE * SIDE; i++)
        if (i % SIDE % 2 != 1 || i / SIDE % 2 != 0)
            world->peak[i] = -1;
}

/* A red laser on a colour sensor: one pixel in four sees it, and that is enough. */
TEST(one_phase) {
    static const struct lasers six = {6, 45, 0, 75, 50};
    g_autofree struct world *world = new_world(45, 30, (struct surface){2, 0.05, 0});
    g_autofree struct merged *merged = merge(world, &six, NULL, keep_one_phase);
    assert_surface(world, merged, 0.02);
}

static void hide_others(struct world *world, int laser) {
    for (int i = 0; i < SIDE * SIDE && laser > 0; i++)
        world->peak[i] = -1;
}

/* Of many sweeps one alone saw something: nothing contradicts it, so that it is believed, and said
 * to be one. */
TEST(alone) {
    g_autofree struct world *world = new_world(45, 30, (struct surface){2, 0, 0});
    g_autofree struct merged *merged = merge(world, &five, NULL, hide_others);
    assert_surface(world, merged, 0.05);
    for (int i = 0; i < N_TEXELS; i++)
        g_assert_true(merged->n[i] == 1 && merged->s[i] > 0);
}

static void raise_second(struct world *world, int laser) {
    world->surface.height = laser == 1 ? 3.5 : 2;
}

static void hide_from_third(struct world *world, int laser) {
    for (int i = 0; i < SIDE * SIDE && laser > 1; i++)
        world->peak[i] = -1;
}

/* Two alone saw something, each something else: neither is believed. */
TEST(contradicted) {
    g_autofree struct world *world = new_world(45, 30, (struct surface){2, 0, 0});
    g_autofree struct merged *merged = merge(world, &five, raise_second, hide_from_third);
    for (int i = 0; i < N_TEXELS; i++)
        g_assert_true(merged->mm[i] == -1 && merged->n[i] == 0 && merged->s[i] == -1);
}

/* A step that one laser alone reaches on its far side, with noise: the error bars of what it alone
 * saw hold the errors there, and are larger than those of what all saw. */
TEST(alone_error) {
    static const struct lasers six = {6, 45, 0, 75, 50};
    g_autofree struct world *world = new_world(45, 30, (struct surface){2, 0.1, 0, 0.4, 0.2});
    struct rig_camera camera = pinhole_to_rig(&world->pinhole, "cam");
    g_autoptr(MdfView) view = mdf_view_new(&camera, world->turntable, &grid);
    g_autoptr(GRand) random = g_rand_new_with_seed(3);
    struct merged m;
    for (int i = 0; i < six.n; i++) {
        struct line_laser laser = {six.theta_deg * DEGREE, 480};
        const double arc = (six.arc_deg + six.arc_step_deg * i) * DEGREE;
        sweep(world, &laser, arc, 0.1, random);
        for (int k = 0; k < SIDE * SIDE && i > 0; k++)
            if (k % SIDE >= SIDE / 2)
                world->peak[k] = -1;
        add(view, world, &laser, arc);
    }
    mdf_view_merge(view, m.mm, m.n, m.s);
    double squares[2] = {0}, errors[2] = {0};
    int n[2] = {0};
    for (int i = 0; i < N_TEXELS; i++) {
        if (m.n[i] == 0)
            continue;
        const int alone = m.n[i] == 1;
        squares[alone] += pow((m.mm[i] - expected_mm(world, i)) / (double)m.s[i], 2);
        errors[alone] += (double)m.s[i];
        n[alone]++;
    }
    g_test_message("%d alone: chi-square %.2f, error bars %.3f mm; of %d others %.3f mm", n[1],
                   squares[1] / n[1], errors[1] / n[1], n[0], errors[0] / n[0]);
    g_assert_cmpint(n[1], >, N_TEXELS / 3);
    g_assert_cmpfloat(squares[1] / n[1], <, 1.5);
    g_assert_cmpfloat(squares[1] / n[1], >, 0.2);
    g_assert_cmpfloat(errors[1] / n[1], >, 2 * errors[0] / n[0]);
}

/* Peaks that would put the surface above the reference plane or below the turntable. */
TEST(impossible_heights) {
    for (int i = 0; i < 2; i++) {
        g_autofree struct world *world =
            new_world(45, 100, (struct surface){i == 0 ? 6.5 : -3, 0, 0});
        struct errors errors = measure(world, 0);
        g_assert_cmpint(errors.missing, ==, N_TEXELS);
    }
}

/* Laser and camera on opposite sides in one plane with the origin, the laser's line across it: the
 * volume is a third of the triangle's area times the line's length of 2. */
TEST(weight) {
    struct line_laser laser = {40 * DEGREE, 480};
    struct rig_laser rig = line_laser_to_rig(&laser, "laser");
    double c[2] = {-650 * sin(1), 650 * cos(1)};
    double l[2] = {480 * sin(40 * DEGREE), 480 * cos(40 * DEGREE)};
    double area = 0.5 * fabs(c[0] * l[1] - c[1] * l[0]);
    double weight = mdf_weight(NULL, &rig, 0, vec3(c[0], 0, c[1]));
    g_assert_cmpfloat_with_epsilon(weight, area * 2 / 3, 1e-6 * weight);
    /* From where the laser stands nothing can be told. */
    g_assert_cmpfloat(mdf_weight(NULL, &rig, 0, rig.position_mm), <, 1e-6 * weight);
    /* Camera in the sheet's plane: neither. */
    g_assert_cmpfloat(mdf_weight(NULL, &rig, G_PI_2, vec3(300, l[0], l[1])), <, 1e-6 * weight);
}

/* The published merge is the plain weighted mean, with the outlier that the robust merge leaves
 * out.
 */
TEST(merge__mean) {
    struct mdf_candidate candidates[3] = {
        {.mm = 1.0F, .tolerance_mm = 0.1F, .frame_mm = 0.1F, .sweep = 0, .weight = 2.0},
        {.mm = 1.0F, .tolerance_mm = 0.1F, .frame_mm = 0.1F, .sweep = 1, .weight = 1.0},
        {.mm = 5.0F, .tolerance_mm = 0.1F, .frame_mm = 0.1F, .sweep = 2, .weight = 1.0},
    };
    g_assert_cmpfloat((double)mdf_merge_mean(candidates, 3).mm, ==, 2.0);
    g_assert_cmpint(mdf_merge_mean(candidates, 3).n, ==, 3);
    g_assert_cmpfloat((double)mdf_merge(candidates, 3, 1).mm, ==, 1.0);
}

/* Depth of a periodic relief of 16 × 12 texels, bilinear between their centres. */
static double relief_at(const float *depth_mm, double x, double y) {
    const int left = (int)floor(x), above = (int)floor(y);
    double sum = 0;
    for (int j = above; j <= above + 1; j++)
        for (int i = left; i <= left + 1; i++)
            sum += (1 - fabs(x - i)) * (1 - fabs(y - j)) *
                   (double)depth_mm[((j + 1200) % 12) * 16 + (i + 1600) % 16];
    return sum;
}

/* Where a flat ray meets the relief of the steep views, the relief has the depth of the ray, also
 * across the border of the tile. */
TEST(traced) {
    static const float theta_deg[] = {0, 60, 70, 55, 65}, phi_deg[] = {0, 35, 130, 230, 320};
    g_autofree float *relief = g_new(float, 12 * 16);
    struct mdf_table *table = mdf_table_new(16, 12, 5, 0.1, theta_deg, phi_deg);
    double worst_mm = 0;
    for (int j = 0; j < 12; j++)
        for (int i = 0; i < 16; i++)
            relief[16 * j + i] = (float)(0.5 + 0.1 * sin(2 * G_PI * (i + 2) / 16) +
                                         0.08 * cos(2 * G_PI * (j + i / 4.0) / 12));
    for (int k = 0; k < 5 * 12 * 16; k++)
        table->depth_mm[k] = relief[k % (12 * 16)];
    table->deepest_mm = 0.8;
    mdf_table_trace(table);
    for (int view = 1; view < 5; view++) { /* the first one has no slant, and is the relief */
        const double slant = tan((double)theta_deg[view] * DEGREE) / 0.1;
        const double phi = (double)phi_deg[view] * DEGREE;
        for (int k = 0; k < 12 * 16; k++) {
            const double depth = (double)table->depth_mm[view * 12 * 16 + k];
            const double x = k % 16 - depth * slant * cos(phi);
            const double y = (int)(k / 16) + depth * slant * sin(phi);
            worst_mm = MAX(worst_mm, fabs(relief_at(relief, x, y) - depth));
        }
    }
    g_test_message("worst difference %.5f mm", worst_mm);
    g_assert_cmpfloat(worst_mm, <, 0.012); /* steps of 0.5 texels are 0.02 to 0.035 mm deep */
    mdf_table_free(table);
}
