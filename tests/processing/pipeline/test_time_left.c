/* The time left of processing is right within a quarter as soon as a tenth of the work is done: in
 * a replay of the demo's session, and of sessions whose views differ more. */
#include <glib.h>
#include <glib/gstdio.h>
#include <math.h>
#include <time.h>

#include "lib/test.h"
#include "pipeline/course.h"

#define MAX_VIEWS  120
#define DEMO_VIEWS 60

/* CPU time of the demo's views (60 × 60 lights, 26 laser positions, five cameras of 192² pixels),
 * in the order in which they were made; one core of an AMD EPYC, two threads, no other work. */
static const struct {
    double theta_deg, btf_s, mdf_s;
} demo[DEMO_VIEWS] = {
    {15, 0.168, 0.452}, {60, 0.163, 0.451}, {30, 0.176, 0.558}, {75, 0.165, 0.267},
    {45, 0.161, 0.623}, {15, 0.172, 0.530}, {60, 0.168, 0.476}, {30, 0.170, 0.514},
    {75, 0.161, 0.261}, {45, 0.164, 0.563}, {15, 0.170, 0.562}, {60, 0.162, 0.482},
    {45, 0.162, 0.528}, {15, 0.175, 0.507}, {60, 0.159, 0.558}, {30, 0.170, 0.504},
    {75, 0.158, 0.279}, {45, 0.165, 0.607}, {15, 0.171, 0.486}, {60, 0.161, 0.509},
    {30, 0.171, 0.509}, {75, 0.158, 0.274}, {45, 0.162, 0.598}, {15, 0.168, 0.550},
    {75, 0.160, 0.267}, {45, 0.162, 0.592}, {15, 0.172, 0.501}, {60, 0.164, 0.500},
    {30, 0.175, 0.502}, {75, 0.160, 0.269}, {45, 0.165, 0.554}, {15, 0.173, 0.539},
    {60, 0.156, 0.474}, {30, 0.162, 0.542}, {75, 0.158, 0.273}, {45, 0.159, 0.540},
    {30, 0.163, 0.445}, {75, 0.160, 0.217}, {45, 0.161, 0.510}, {15, 0.164, 0.537},
    {60, 0.162, 0.497}, {30, 0.173, 0.531}, {75, 0.164, 0.267}, {45, 0.163, 0.537},
    {15, 0.172, 0.478}, {60, 0.161, 0.522}, {30, 0.169, 0.539}, {75, 0.158, 0.236},
    {60, 0.160, 0.440}, {30, 0.168, 0.537}, {75, 0.160, 0.235}, {45, 0.166, 0.658},
    {15, 0.175, 0.544}, {60, 0.162, 0.397}, {30, 0.168, 0.530}, {75, 0.159, 0.260},
    {45, 0.161, 0.601}, {15, 0.168, 0.480}, {60, 0.160, 0.509}, {30, 0.170, 0.682},
};
static const double demo_after_s = 1.59 + 0.15 + 1.73; /* settling, writing the MDF, eigen-maps */
/* Of earlier runs. */
static const struct time_left_rates known = {
    .unit_s = {[TIME_LEFT_BTF] = 0.0745, [TIME_LEFT_MDF] = 0.494}};
#define DEMO_MEGAPIXELS (192 * 192 / 1e6)

/* A computation of its own: tasks in the order they are queued, each to the thread that is free
 * first, of which each gets a part of a processor (speed). */
struct course {
    struct time_left_task tasks[TIME_LEFT_STAGES * MAX_VIEWS];
    int n, n_threads;
    double after_s, after_said_s, speed;
};

/* The largest error from a tenth to 19 twentieths of the time. Asked every hundredth of it. */
static double worst_error(const struct course *course, const struct time_left_rates *rates) {
    double begun_s[TIME_LEFT_STAGES * MAX_VIEWS], free_s[16] = {0}, views_s = 0, worst = 0;
    for (int i = 0; i < course->n; i++) {
        int thread = 0;
        for (int t = 1; t < course->n_threads; t++)
            thread = free_s[t] < free_s[thread] ? t : thread;
        begun_s[i] = free_s[thread];
        free_s[thread] += course->tasks[i].cpu_s / course->speed;
        views_s = MAX(views_s, free_s[thread]);
    }
    const double total_s = views_s + course->after_s / course->speed;
    struct time_left_speed speed = {0};
    for (int percent = 1; percent <= 95; percent++) {
        const double now_s = percent / 100.0 * total_s;
        struct time_left_task tasks[TIME_LEFT_STAGES * MAX_VIEWS];
        for (int i = 0; i < course->n; i++) {
            const double spent_s = (now_s - begun_s[i]) * course->speed;
            tasks[i] = course->tasks[i];
            tasks[i].state = spent_s <= 0                       ? TIME_LEFT_WAITS
                             : spent_s < course->tasks[i].cpu_s ? TIME_LEFT_RUNS
                                                                : TIME_LEFT_MADE;
            tasks[i].cpu_s = CLAMP(spent_s, 0, course->tasks[i].cpu_s);
        }
        const int n_busy = now_s < views_s ? course->n_threads : 1;
        time_left_speed_add(&speed, total_s / 100, n_busy * course->speed * total_s / 100, n_busy,
                            now_s);
        const double after_s =
            course->after_said_s * MIN((total_s - now_s) / (total_s - views_s + 1e-9), 1);
        const double left_s = time_left_views_s(tasks, course->n, course->n_threads, rates) /
                                  time_left_speed_of(&speed, n_busy) +
                              after_s / course->speed;
        if (percent >= 10)
            worst = MAX(worst, fabs(left_s / (total_s - now_s) - 1));
    }
    return worst;
}

static void add(struct course *course, enum time_left_work stage, double theta_deg, double units,
                double cpu_s) {
    if (cpu_s > 0)
        course->tasks[course->n++] = (struct time_left_task){
            .stage = stage, .theta_deg = theta_deg, .units = units, .cpu_s = cpu_s};
}

TEST(recorded) {
    static const int threads[] = {1, 2, 4, 8};
    static const double speeds[] = {1, 0.3};
    for (gsize t = 0; t < G_N_ELEMENTS(threads); t++)
        for (gsize s = 0; s < G_N_ELEMENTS(speeds); s++)
            for (double slower = 0.5; slower < 3; slower *= 2) { /* than the rates say */
                struct course course = {.n_threads = threads[t],
                                        .speed = speeds[s],
                                        .after_s = slower * demo_after_s,
                                        .after_said_s = 0.8 * slower * demo_after_s};
                for (int i = 0; i < DEMO_VIEWS; i++) {
                    add(&course, TIME_LEFT_BTF, demo[i].theta_deg, 60 * DEMO_MEGAPIXELS,
                        slower * demo[i].btf_s);
                    add(&course, TIME_LEFT_MDF, demo[i].theta_deg, 26 * DEMO_MEGAPIXELS,
                        slower * demo[i].mdf_s);
                }
                const double error = worst_error(&course, &known);
                g_test_message("%d threads at %g, %g times as slow as before: %.0f %%", threads[t],
                               speeds[s], slower, 100 * error);
                g_assert_cmpfloat(error, <, 0.25);
            }
}

/* Five rings of twelve views, of which those from above take several times as long as grazing ones.
 */
TEST(rings) {
    static const double costs_s[][2] = {{0.4, 0.9}, {0.4, 0.05}, {0.4, 0}, {0, 0.9}, {0.1, 4}};
    static const int threads[] = {1, 2, 4};
    g_autoptr(GRand) rand = g_rand_new_with_seed(5);
    for (gsize c = 0; c < G_N_ELEMENTS(costs_s); c++)
        for (gsize t = 0; t < G_N_ELEMENTS(threads); t++) {
            struct course course = {.n_threads = threads[t], .speed = 1};
            struct time_left_rates rates = {.unit_s = {costs_s[c][0], costs_s[c][1]}};
            for (int k = 0; k < DEMO_VIEWS; k++) {
                const double theta_deg = 15 + 15 * (time_left_view(k, DEMO_VIEWS) / 12);
                const double above = cos(theta_deg * G_PI / 180);
                add(&course, TIME_LEFT_BTF, theta_deg, 1,
                    costs_s[c][0] * (0.5 + above) * g_rand_double_range(rand, 0.8, 1.2));
                add(&course, TIME_LEFT_MDF, theta_deg, 1,
                    costs_s[c][1] * above * g_rand_double_range(rand, 0.8, 1.2));
            }
            const double error = worst_error(&course, &rates);
            g_test_message("%g and %g s a view, %d threads: %.0f %%", costs_s[c][0], costs_s[c][1],
                           threads[t], 100 * error);
            g_assert_cmpfloat(error, <, 0.25);
        }
}

TEST(order) {
    for (int n = 1; n < 200; n++) {
        g_autofree int *seen = g_new0(int, n);
        for (int k = 0; k < n; k++)
            seen[time_left_view(k, n)]++;
        for (int view = 0; view < n; view++)
            g_assert_cmpint(seen[view], ==, 1);
    }
}

/* Two threads that got half a processor each: one alone gets a whole one. */
TEST(speed) {
    struct time_left_speed speed = {0};
    g_assert_cmpfloat(time_left_speed_of(&speed, 2), ==, 1);
    for (int i = 0; i < 100; i++)
        time_left_speed_add(&speed, 0.5, 0.5, 2, i * 0.5);
    g_assert_cmpfloat_with_epsilon(time_left_speed_of(&speed, 2), 0.5, 1e-9);
    g_assert_cmpfloat_with_epsilon(time_left_speed_of(&speed, 1), 1, 1e-9);
    /* Where one thread follows two that got a tenth each, and the process gets as much as before,
     * nothing of that changes meanwhile: what two threads got does not count as what one gets. */
    struct time_left_speed shared = {0};
    for (int i = 0; i < 120; i++) {
        time_left_speed_add(&shared, 0.5, 0.1, i < 100 ? 2 : 1, i * 0.5);
        g_assert_cmpfloat_with_epsilon(time_left_speed_of(&shared, 1), 0.2, 1e-9);
    }
    /* What was before counts less: a time x counts x times as much as now. */
    for (int i = 0; i < 100; i++)
        time_left_speed_add(&speed, 0.5, 0.2, 2, 50 + i * 0.5);
    g_assert_cmpfloat_with_epsilon(time_left_speed_of(&speed, 2), 0.275, 0.005);
    for (int i = 0; i < 800; i++)
        time_left_speed_add(&speed, 0.5, 0.2, 2, 100 + i * 0.5);
    g_assert_cmpfloat_with_epsilon(time_left_speed_of(&speed, 2), 0.203, 0.002);
}

/* What one run measured is there for the next; a damaged file is none. */
TEST(rates) {
    struct time_left_rates rates, read;
    g_autofree char *path =
        g_build_filename(g_get_user_cache_dir(), "mesorig", "processing-rates", NULL);
    g_assert_false(time_left_rates_load(&rates));
    for (int i = 0; i < TIME_LEFT_WORKS; i++) {
        g_assert_cmpfloat(rates.unit_s[i], >, 0);
        rates.unit_s[i] = 0.1 * (i + 1);
    }
    rates.unit_s[TIME_LEFT_FACTORS] = NAN; /* is not kept */
    time_left_rates_save(&rates);
    g_assert_true(time_left_rates_load(&read));
    for (int i = 0; i < TIME_LEFT_FACTORS; i++)
        g_assert_cmpfloat_with_epsilon(read.unit_s[i], rates.unit_s[i], 1e-12);
    g_assert_cmpfloat(read.unit_s[TIME_LEFT_FACTORS], >, 0);
    g_assert_true(g_file_set_contents(path, "\1\2not a key file", -1, NULL));
    g_assert_false(time_left_rates_load(&read));
    g_assert_cmpfloat(read.unit_s[TIME_LEFT_BTF], >, 0);
    g_autofree char *folder = g_path_get_dirname(path);
    g_assert_cmpint(g_unlink(path), ==, 0);
    g_assert_cmpint(g_rmdir(folder), ==, 0);
    g_assert_cmpint(g_rmdir(g_get_user_cache_dir()), ==, 0);
}

/* A run that takes little of one kind of work mends that rate as well; a small run hardly changes
 * it, and what scatters from run to run is averaged. */
TEST(learned) {
    struct time_left_rates rates = {.unit_s = {[TIME_LEFT_BTF] = 0.2, [TIME_LEFT_MDF_FILE] = 7.2}};
    struct time_left_made made[TIME_LEFT_WORKS] = {[TIME_LEFT_BTF] = {0.1, 0.1}};
    time_left_rates_learn(&rates, made);
    g_assert_cmpfloat_with_epsilon(rates.unit_s[TIME_LEFT_BTF], 0.208, 1e-9);
    g_assert_cmpfloat_with_epsilon(rates.unit_s[TIME_LEFT_MDF_FILE], 7.2, 1e-9);
    made[TIME_LEFT_BTF] = (struct time_left_made){50, 200};
    made[TIME_LEFT_MDF_FILE] = (struct time_left_made){0.15, 0.25};
    time_left_rates_learn(&rates, made);
    g_assert_cmpfloat_with_epsilon(rates.unit_s[TIME_LEFT_BTF], 0.229, 1e-9);
    g_assert_cmpfloat_with_epsilon(rates.unit_s[TIME_LEFT_MDF_FILE], 0.6, 1e-9);
}

static double time_left_spent_s(void) {
    struct timespec now;
    g_assert_cmpint(clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now), ==, 0);
    return (double)now.tv_sec + (double)now.tv_nsec / 1e9;
}

/* What follows the views goes by its own pace as soon as that is known: of work that is said to
 * take 10 s nine tenths take 0.1 s, so that the rest of it and 5 s after it will take little. */
TEST(pace) {
    const struct time_left_rates said = {
        .unit_s = {[TIME_LEFT_BTF] = 1, [TIME_LEFT_COLUMNS] = 10, [TIME_LEFT_FACTORS] = 5}};
    g_autofree char *path =
        g_build_filename(g_get_user_cache_dir(), "mesorig", "processing-rates", NULL);
    g_autofree char *folder = g_path_get_dirname(path);
    time_left_rates_save(&said);
    g_setenv("MESORIG_TIME_LEFT", "idle", TRUE);
    Course *course = course_new(2);
    course_expect(course, TIME_LEFT_COLUMNS, 1);
    course_expect(course, TIME_LEFT_FACTORS, 1);
    g_assert_cmpfloat_with_epsilon(course_left_s(course), 15, 1e-9);
    course_begin(course, TIME_LEFT_COLUMNS);
    for (const double begun_s = time_left_spent_s(); time_left_spent_s() < begun_s + 0.1;)
        ;
    g_assert_cmpfloat(course_left_s(course), <, 14.95);
    g_assert_cmpfloat(course_left_s(course), >, 14);
    course_advance(course, 0.9);
    const double left_s = course_left_s(course);
    g_test_message("%g s are left", left_s);
    g_assert_cmpfloat(left_s, >, 0.1 / 9);
    g_assert_cmpfloat(left_s, <, 1);
    course_end(course, TIME_LEFT_COLUMNS, TRUE);
    g_assert_cmpfloat(course_left_s(course), <, left_s);
    course_end(course, TIME_LEFT_FACTORS, FALSE);
    g_assert_cmpfloat(course_left_s(course), ==, 0);
    course_free(course);
    g_unsetenv("MESORIG_TIME_LEFT");
    g_assert_cmpint(g_unlink(path), ==, 0);
    g_assert_cmpint(g_rmdir(folder), ==, 0);
    g_assert_cmpint(g_rmdir(g_get_user_cache_dir()), ==, 0);
}

BEFORE_TESTS {
    g_autofree char *cache = g_dir_make_tmp("mesorig-cache-XXXXXX", NULL);
    g_assert_nonnull(cache);
    g_setenv("XDG_CACHE_HOME", cache, TRUE);
}
