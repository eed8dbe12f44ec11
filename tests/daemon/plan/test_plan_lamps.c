/* [lights] sampling = adaptive: which shots come first, what a round costs, and what is refused. */
#include "lib/plan_case.h"
#include "lib/test.h"

#include <math.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))

static const double thetas_deg[] = {15, 30, 45, 60, 75};
#define DIRECTIONS "[views]\npreset = 12x5\n[lights]\npreset = 12x5\noffset_deg = 15\n"

struct pair {
    struct vec3 view, light;
};

/* The pairs that the lamps' shots of a plan show, as planned directions say it: of those that are
 * chosen, or of all. */
static GArray *pairs_of(const struct plan *plan, const gboolean *chosen) {
    GArray *pairs = g_array_new(FALSE, FALSE, sizeof(struct pair));
    for (int i = 0; i < plan->session.n_shots; i++) {
        const struct session_shot *shot = &plan->session.shots[i];
        for (int v = 0; v < plan->session.n_views; v++) {
            const struct session_direction *view = &plan->session.views[v];
            if (shot->kind != SHOT_LAMP || (chosen && !chosen[i]) ||
                !camera_set_has(shot->cameras, view->device) ||
                fabs(remainder(view->turntable_deg - shot->turntable_deg, 360)) > 1e-6)
                continue;
            const struct session_direction *light = &plan->session.lights[shot->source];
            const struct pair pair = {rig_direction(RAD(view->theta_deg), RAD(view->phi_deg)),
                                      rig_direction(RAD(light->theta_deg), RAD(light->phi_deg))};
            g_array_append_val(pairs, pair);
        }
    }
    return pairs;
}

/* RMS distance from all pairs to the nearest of some. */
static double gap_of(const GArray *all, const GArray *some) {
    double sum = 0;
    for (guint i = 0; i < all->len; i++) {
        const struct pair *p = &g_array_index(all, struct pair, i);
        double nearest = INFINITY;
        for (guint k = 0; k < some->len; k++) {
            const struct pair *q = &g_array_index(some, struct pair, k);
            nearest =
                MIN(nearest, 4 - 2 * vec3_dot(p->view, q->view) - 2 * vec3_dot(p->light, q->light));
        }
        sum += nearest;
    }
    return sqrt(sum / all->len);
}

static gboolean *first_of(const struct plan *plan, struct session_conf *conf, int first,
                          const struct rig *rig, const struct rig_timing *timing) {
    const int n = plan->session.n_shots;
    g_autofree const struct session_shot **list = g_new(const struct session_shot *, n);
    gboolean *ret = g_new0(gboolean, n);
    for (int i = 0; i < n; i++)
        list[i] = &plan->session.shots[i];
    conf->light_first = first;
    plan_first_lamps(conf, rig, timing, list, n, ret);
    return ret;
}

static int count(const gboolean *chosen, int n) {
    int sum = 0;
    for (int i = 0; i < n; i++)
        sum += chosen[i] != 0;
    return sum;
}

/* The first shots are as many as asked for, contain those of a smaller first, and lie nearer to all
 * pairs than any of twenty sets at random. */
TEST(first) {
    g_auto(SessionConf) conf = plan_case_conf(DIRECTIONS "sampling = adaptive\n");
    const struct rig rig = plan_case_rig(thetas_deg, 5);
    const struct rig_timing timing = plan_case_timing(0.25);
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    const int n = plan->session.n_shots;
    g_autofree gboolean *two = first_of(plan, &conf, 2, &rig, &timing);
    g_autofree gboolean *four = first_of(plan, &conf, 4, &rig, &timing);
    g_autofree gboolean *again = first_of(plan, &conf, 4, &rig, &timing);
    g_assert_cmpint(count(two, n), ==, 24);
    g_assert_cmpint(count(four, n), ==, 48);
    for (int i = 0; i < n; i++) {
        g_assert_true(four[i] || !two[i]);
        g_assert_cmpint(four[i], ==, again[i]);
        g_assert_true(!four[i] || plan->session.shots[i].kind == SHOT_LAMP);
    }
    g_autoptr(GArray) all = pairs_of(plan, NULL);
    g_autoptr(GArray) some = pairs_of(plan, four);
    g_assert_cmpint(all->len, ==, 3600);
    g_assert_cmpint(some->len, ==, 240);
    const double gap = gap_of(all, some);
    double least = INFINITY;
    g_autoptr(GRand) random = g_rand_new_with_seed(1);
    for (int set = 0; set < 20; set++) {
        g_autofree gboolean *chosen = g_new0(gboolean, n);
        for (int taken = 0; taken < 48;) {
            const int i = g_rand_int_range(random, 0, n);
            if (chosen[i] || plan->session.shots[i].kind != SHOT_LAMP)
                continue;
            chosen[i] = TRUE;
            taken++;
        }
        g_autoptr(GArray) pairs = pairs_of(plan, chosen);
        least = MIN(least, gap_of(all, pairs));
    }
    g_test_message("RMS distance to the nearest of 240 pairs: %.3f, at random %.3f or more", gap,
                   least);
    g_assert_cmpfloat(gap, <, least);
}

/* The plan tells how many may follow, and what the first round alone takes. */
TEST(times) {
    g_auto(SessionConf) conf = plan_case_conf(DIRECTIONS "sampling = adaptive\n");
    g_auto(SessionConf) whole = plan_case_conf(DIRECTIONS);
    g_auto(SessionConf) wide = plan_case_conf(DIRECTIONS "sampling = adaptive\nfirst = 1000\n");
    const struct rig rig = plan_case_rig(thetas_deg, 5);
    const struct rig_timing timing = plan_case_timing(0.25);
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    g_autoptr(Plan) all = plan_case_build(&whole, &rig, &timing);
    g_autoptr(Plan) none_later = plan_case_build(&wide, &rig, &timing);
    g_assert_cmpint(plan->n_later_lamps, ==, 720 - 48);
    g_assert_cmpint(plan->n_later_sweeps, ==, 0);
    g_assert_cmpfloat(plan->first_s, <, 0.2 * all->predicted_s);
    g_assert_cmpfloat(plan->predicted_s, >=, all->predicted_s);
    g_assert_cmpfloat(plan->predicted_s, <, 1.3 * all->predicted_s);
    g_assert_cmpint(plan->bytes, ==, all->bytes);
    g_assert_cmpint(plan->bytes_least, <, plan->bytes / 5);
    g_assert_cmpint(all->n_later_lamps, ==, 0);
    g_assert_cmpint(none_later->n_later_lamps, ==, 0);
    g_assert_cmpfloat(none_later->first_s, ==, none_later->predicted_s);
}

/* Some of a plan's shots in an order of their own: the same shots, as quick as in the plan's order
 * or quicker; and with a budget's clock, whether they are done or not. */
TEST(left) {
    g_auto(SessionConf) conf = plan_case_conf(DIRECTIONS);
    const struct rig rig = plan_case_rig(thetas_deg, 5);
    const struct rig_timing timing = plan_case_timing(0.25);
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    struct session_shot *shots = (struct session_shot *)(gpointer)plan->session.shots;
    g_autoptr(GPtrArray) list = g_ptr_array_new(), before = g_ptr_array_new();
    for (int i = 1; i < plan->session.n_shots; i += 7) {
        g_ptr_array_add(list, &shots[i]);
        g_ptr_array_add(before, &shots[i]);
    }
    const int n = (int)list->len;
    const double planned_s =
        plan_remaining_s((gpointer)before->pdata, n, &conf, &rig, &timing, NULL);
    plan_order_left((struct session_shot **)list->pdata, n, &conf, &rig, &timing);
    const double quick_s = plan_remaining_s((gpointer)list->pdata, n, &conf, &rig, &timing, NULL);
    const double clock_s = plan_lamps_s((gpointer)before->pdata, n, &conf, &rig, &timing);
    g_test_message("%d shots: %.1f s in the plan's order, %.1f s in their own", n, planned_s,
                   quick_s);
    g_assert_cmpfloat(quick_s, <, planned_s);
    g_assert_cmpfloat_with_epsilon(clock_s, quick_s + plan_homing_s(&rig, &timing), 1e-9);
    for (int i = 0; i < n; i++) {
        g_assert_true(g_ptr_array_find(list, before->pdata[i], NULL));
        shots[1 + 7 * i].state = SHOT_DONE;
    }
    g_assert_cmpfloat(plan_lamps_s((gpointer)before->pdata, n, &conf, &rig, &timing), ==, clock_s);
}

TEST(refused) {
    static const struct {
        const char *directions, *says;
        guint32 mounts;
    } cases[] = {
        {"[views]\nrings = 15:1\n[lights]\npreset = 12x5\nsampling = adaptive\n",
         "[lights] sampling: adaptive predicts pictures from those of other views", 0},
        {DIRECTIONS "sampling = adaptive\n[lasers]\nrings = 15:2\noffset_deg = 15\n",
         "mounted by hand at several places", 2},
        {DIRECTIONS "sampling = adaptive\nbudget_min = 0.5\n",
         "[lights] budget_min: 0.5 min are too few for the first round, whose 48 shots take", 0},
    };
    const struct rig rig = plan_case_rig(thetas_deg, 5);
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_auto(SessionConf) conf = plan_case_conf(cases[i].directions);
        struct rig_timing timing = plan_case_timing(0.25);
        timing.mounts[0] = cases[i].mounts;
        plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_LIMITS, cases[i].says);
    }
}
