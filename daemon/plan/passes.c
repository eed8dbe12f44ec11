#include "passes.h"

#include <math.h>

/* Maximum delay in seconds that the daemon itself adds to a trigger or a report. */
#define HOST_S 0.005
/* The angles of the table at which passes begin and end are multiples of this. */
#define STEP_DEG 1e-3

#define RAD(deg) ((deg) * (G_PI / 180))
#define DEG(rad) ((rad) * (180 / G_PI))

static gboolean is_continuous(const struct session_conf *conf) {
    return conf->motion == MOTION_CONTINUOUS;
}

char *passes_refused(const struct session_conf *conf, const struct rig *rig,
                     const struct rig_timing *timing, struct camera_set cameras) {
    const struct axis_motion *table = &timing->turntable;
    if (!is_continuous(conf))
        return NULL;
    if (!table->wraps && !(table->min_deg < table->max_deg))
        return g_strdup("there is no [axis turntable]: leave motion out");
    if (table->report_ms <= 0)
        return g_strdup("the driver of [axis turntable] does not report positions with their "
                        "times: set motion = standing");
    for (int c = 0; c < rig->n_cameras; c++)
        if (camera_set_has(cameras, c) && timing->stamp_us[c] < 0)
            return g_strdup_printf("camera %s does not report when its frames were exposed, or has "
                                   "a rolling shutter: set motion = standing",
                                   rig->cameras[c].name);
    if (conf->order == ORDER_VIEWS)
        return g_strdup("order = views takes all lamps at one angle of the turntable, but the "
                        "table turns: set order = quickest");
    return NULL;
}

static double exposure_s_of(const struct session_conf *conf) {
    return conf->exposures_us[conf->n_exposures - 1] * 1e-6;
}

/* Rounds down to two significant digits. */
static double passes_round(double deg_s) {
    const double unit = pow(10, floor(log10(deg_s)) - 1);
    return floor(deg_s / unit + 1e-9) * unit;
}

struct passes_speed passes_speed(const struct session_conf *conf, const struct rig *rig,
                                 const struct rig_timing *timing, struct camera_set cameras) {
    const struct session_grid *grid = &conf->grid;
    const double r_mm = hypot(grid->width_mm, grid->height_mm) / 2;
    const double texel_mm = MIN(grid->width_mm / grid->width, grid->height_mm / grid->height);
    const double exposure_s = exposure_s_of(conf);
    gint64 stamp_us = 0;
    for (int c = camera_set_next(cameras, -1); c >= 0; c = camera_set_next(cameras, c))
        stamp_us = MAX(stamp_us, timing->stamp_us[c]);
    const double pose_s = 2 * (1e-6 * (double)stamp_us + 1e-3 * timing->turntable.stamp_ms);
    const double most = DEG(conf->blur_texels * texel_mm / r_mm / MAX(exposure_s, pose_s));
    struct passes_speed ret = {.by_axis = most >= timing->turntable.speed_deg_s,
                               .by_pose = pose_s > exposure_s};
    ret.deg_s = ret.by_axis ? timing->turntable.speed_deg_s : passes_round(most);
    ret.blur_mm = RAD(ret.deg_s) * r_mm * exposure_s;
    ret.blur_texels = ret.blur_mm / texel_mm;
    ret.pose_texels = RAD(ret.deg_s) * r_mm * pose_s / texel_mm;
    return ret;
}

double passes_at_deg(const struct session_pass *pass, double turntable_deg) {
    const double turns = ceil((pass->from_deg - turntable_deg) / 360);
    return pass->number > 0 ? turntable_deg + 360 * turns : turntable_deg;
}

double passes_lead_s(const struct session_shot *before, const struct session_shot *shot,
                     double frame_s, double exposure_s, const struct axis_motion *table) {
    const struct session_pass *pass = &shot->pass;
    const double v = pass->speed_deg_s, at = passes_at_deg(pass, shot->turntable_deg);
    if (session_follows_in_pass(before, shot))
        return (at - passes_at_deg(pass, before->turntable_deg)) / v - frame_s;
    return v / table->accel_deg_s2 + (at - pass->from_deg - axis_ramp_deg(table, v)) / v +
           exposure_s / 2 - frame_s;
}

double passes_exit_s(const struct session_shot *shot, double exposure_s,
                     const struct axis_motion *table) {
    const struct session_pass *pass = &shot->pass;
    const double v = pass->speed_deg_s;
    const double left = pass->from_deg + pass->by_deg - axis_ramp_deg(table, v) -
                        passes_at_deg(pass, shot->turntable_deg);
    return left / v - exposure_s / 2 + v / table->accel_deg_s2 + table->settle_ms / 1000;
}

/* Shots that may share a pass, in the order in which the table passes them. */
struct group {
    struct session_shot *const *shots;
    int n;
    double *at_deg; /* angles of the table, increasing */
    double speed_deg_s, frame_s, exposure_s, readout_s;
    /* angle of a pass before its first shot, and angle after its last shot */
    double lead_deg, behind_deg;
    const struct axis_motion *table;
};

static double slowest_s(const gint64 *camera_us, struct camera_set cameras) {
    gint64 longest_us = 0;
    for (int c = camera_set_next(cameras, -1); c >= 0; c = camera_set_next(cameras, c))
        longest_us = MAX(longest_us, camera_us[c]);
    return 1e-6 * (double)longest_us;
}

static void measure(struct group *group, const struct session_conf *conf, const struct rig *rig,
                    const struct rig_timing *timing) {
    struct camera_set cameras = {{0}};
    for (int i = 0; i < group->n; i++)
        cameras = camera_set_union(cameras, group->shots[i]->cameras);
    const struct axis_motion *table = group->table = &timing->turntable;
    const double v = passes_speed(conf, rig, timing, cameras).deg_s, ramp = axis_ramp_deg(table, v);
    group->speed_deg_s = v;
    group->exposure_s = exposure_s_of(conf);
    group->frame_s = slowest_s(timing->trigger_us, cameras) + group->exposure_s;
    group->readout_s = slowest_s(timing->readout_us, cameras);
    /* The angle before the first shot gives time for at least two reports of the position at the
     * final speed. The angle behind the last shot gives time for at least one report after the last
     * exposure. */
    group->lead_deg =
        ramp + v * (1e-3 * (table->settle_ms + 3 * table->report_ms) + HOST_S + group->frame_s);
    group->behind_deg = ramp + v * (2e-3 * table->report_ms + HOST_S + group->exposure_s);
}

static struct session_pass pass_of(const struct group *group, int first, int last) {
    const double from = floor((group->at_deg[first] - group->lead_deg) / STEP_DEG) * STEP_DEG;
    const double to = ceil((group->at_deg[last] + group->behind_deg) / STEP_DEG) * STEP_DEG;
    return (struct session_pass){
        .from_deg = from, .by_deg = to - from, .speed_deg_s = group->speed_deg_s};
}

/* Returns whether shots first … last fit into one pass. */
static gboolean fit(const struct group *group, int first, int last) {
    const double least_deg = group->speed_deg_s * (group->frame_s + group->readout_s + HOST_S);
    const struct session_pass pass = pass_of(group, first, last);
    for (int i = first; i < last; i++)
        if (group->at_deg[i + 1] - group->at_deg[i] < least_deg)
            return FALSE;
    return group->table->wraps || (pass.from_deg >= group->table->min_deg &&
                                   pass.from_deg + pass.by_deg <= group->table->max_deg);
}

static double pass_s(const struct group *group, const struct session_pass *pass) {
    const double v = pass->speed_deg_s;
    return pass->by_deg / v + v / group->table->accel_deg_s2 + group->table->settle_ms / 1000;
}

/* Divides the shots of a group into passes and stops so that they take the shortest time (dynamic
 * programming over the shots in order). ret_first gives, for each shot that ends a pass, the first
 * shot of the pass. For a shot for which the table stands still, it gives the shot itself. */
static void divide(const struct group *group, int *ret_first) {
    const int n = group->n;
    g_autofree double *best_s = g_new0(double, n + 1), *end_deg = g_new0(double, n + 1);
    for (int last = 0; last < n; last++) {
        best_s[last + 1] = G_MAXDOUBLE;
        for (int first = last; first >= 0; first--) {
            if (first < last && !fit(group, first, last))
                continue;
            const struct session_pass pass = pass_of(group, first, last);
            const double from = first == last ? group->at_deg[last] : pass.from_deg;
            double s = first == 0 ? 0 : axis_move_time_s(group->table, end_deg[first], from);
            s = best_s[first] + (first == 0 ? s : MAX(s, group->readout_s));
            s += first == last ? group->frame_s : pass_s(group, &pass);
            if (s >= best_s[last + 1] - 1e-9)
                continue;
            best_s[last + 1] = s;
            end_deg[last + 1] = first == last ? from : pass.from_deg + pass.by_deg;
            ret_first[last] = first;
        }
    }
}

static void set_group(struct group *group, int *number) {
    g_autofree int *first = g_new(int, group->n);
    divide(group, first);
    for (int last = group->n - 1; last >= 0; last = first[last] - 1) {
        struct session_pass pass = pass_of(group, first[last], last);
        if (first[last] == last)
            continue;
        pass.number = ++*number;
        for (int i = first[last]; i <= last; i++)
            group->shots[i]->pass = pass;
    }
}

static gboolean can_be_in_pass(const struct session_shot *shot) {
    return shot->kind == SHOT_LAMP && shot->state != SHOT_SKIPPED;
}

/* Returns whether two shots of the same lamp differ only in the angle of the turntable and in their
 * cameras. */
static gboolean are_alike(const struct session_shot *a, const struct session_shot *b,
                          const struct rig *rig) {
    return can_be_in_pass(a) && can_be_in_pass(b) && a->device == b->device &&
           a->arc_deg == b->arc_deg && rig_arm_deg(rig, a->cameras) == rig_arm_deg(rig, b->cameras);
}

int passes_set(struct session_shot *const *shots, int n, const struct session_conf *conf,
               const struct rig *rig, const struct rig_timing *timing, int number) {
    g_autofree double *at_deg = g_new(double, n + 1);
    for (int i = 0; i < n; i++)
        shots[i]->pass = (struct session_pass){0};
    for (int i = 0, k; i < n && is_continuous(conf); i += k) {
        at_deg[0] = shots[i]->turntable_deg;
        for (k = 1; i + k < n && are_alike(shots[i], shots[i + k], rig); k++) {
            const double at = shots[i + k]->turntable_deg;
            at_deg[k] = at + (timing->turntable.wraps && at < at_deg[0] ? 360 : 0);
            if (at_deg[k] <= at_deg[k - 1])
                break;
        }
        struct group group = {.shots = shots + i, .n = k, .at_deg = at_deg};
        if (k < 2)
            continue;
        measure(&group, conf, rig, timing);
        set_group(&group, &number);
    }
    return number;
}

double passes_after_s(const struct session_shot *before, const struct session_shot *shot,
                      const struct session_conf *conf, const struct rig *rig,
                      const struct rig_timing *timing) {
    if (!is_continuous(conf) || !are_alike(before, shot, rig))
        return G_MAXDOUBLE;
    const double way = shot->turntable_deg - before->turntable_deg;
    const double forward = way < 0 && timing->turntable.wraps ? way + 360 : way;
    const struct camera_set both = camera_set_union(before->cameras, shot->cameras);
    const double s = forward / passes_speed(conf, rig, timing, both).deg_s;
    return s >= exposure_s_of(conf) + slowest_s(timing->trigger_us, shot->cameras) +
                       slowest_s(timing->readout_us, before->cameras) + HOST_S
               ? s
               : G_MAXDOUBLE;
}

static int compare(gconstpointer a, gconstpointer b) {
    const double x = ((const struct session_shot *)a)->turntable_deg,
                 y = ((const struct session_shot *)b)->turntable_deg;
    return (x > y) - (x < y);
}

/* Sorts shots that are alike (are_alike()) by the angle of the table. If the table turns without
 * limits, the order begins with the shot after the widest gap between two angles. */
static void sort(GArray *alike, gboolean wraps) {
    const guint n = alike->len;
    guint first = 0;
    double widest = 0;
    g_array_sort(alike, compare);
    for (guint i = 0; wraps && i < n; i++) {
        const struct session_shot *before =
            &g_array_index(alike, struct session_shot, (i + n - 1) % n);
        const double gap = g_array_index(alike, struct session_shot, i).turntable_deg -
                           before->turntable_deg + (i == 0 ? 360 : 0);
        if (gap > widest + 1e-9) {
            widest = gap;
            first = i;
        }
    }
    g_autofree struct session_shot *sorted =
        g_memdup2(alike->data, n * sizeof(struct session_shot));
    for (guint i = 0; i < n; i++)
        g_array_index(alike, struct session_shot, i) = sorted[(first + i) % n];
}

/* Returns a key that is the same for alike shots; g_free(). */
static char *key_of(const struct session_shot *shot, const struct rig *rig) {
    return g_strdup_printf("%d %.17g %.17g", shot->device, shot->arc_deg,
                           rig_arm_deg(rig, shot->cameras));
}

/* Returns a table that maps the key of each group of alike shots to a GArray of copies of these
 * shots. */
static GHashTable *list_alike(const GArray *shots, const struct rig *rig) {
    GHashTable *table =
        g_hash_table_new_full(g_str_hash, g_str_equal, g_free, (GDestroyNotify)g_array_unref);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = &g_array_index(shots, struct session_shot, i);
        char *key = can_be_in_pass(shot) ? key_of(shot, rig) : NULL;
        GArray *alike = key ? g_hash_table_lookup(table, key) : NULL;
        if (key && !alike) {
            alike = g_array_new(FALSE, FALSE, sizeof(struct session_shot));
            g_hash_table_insert(table, g_strdup(key), alike);
        }
        if (alike)
            g_array_append_vals(alike, shot, 1);
        g_free(key);
    }
    return table;
}

/* Takes the list of a shot out of the table and returns it. The caller then owns it. Returns NULL
 * if the shot has no key, or if its list is empty. Also returns NULL if the list of its key was
 * already taken out; *ret_later is then TRUE. The caller therefore gets each list once, for the
 * first of its shots. */
static GArray *take_list(GHashTable *table, const struct session_shot *shot, const struct rig *rig,
                         gboolean *ret_later) {
    g_autofree char *key = can_be_in_pass(shot) ? key_of(shot, rig) : NULL;
    GArray *alike = key ? g_hash_table_lookup(table, key) : NULL;
    *ret_later = key && !alike;
    if (!alike || alike->len == 0)
        return NULL;
    g_array_ref(alike);
    g_hash_table_remove(table, key);
    return alike;
}

/* Returns whether passes_set() would put at least some of the sorted shots into passes. */
static gboolean any_in_pass(GArray *alike, const struct session_conf *conf, const struct rig *rig,
                            const struct rig_timing *timing) {
    g_autofree struct session_shot *copies =
        g_memdup2(alike->data, alike->len * sizeof(struct session_shot));
    g_autofree struct session_shot **list = g_new(struct session_shot *, alike->len + 1);
    for (guint i = 0; i < alike->len; i++)
        list[i] = &copies[i];
    return passes_set(list, (int)alike->len, conf, rig, timing, 0) > 0;
}

/* Empties the lists in which no shot would be in a pass. Sorts the other lists. */
static void empty_lists_without_passes(GHashTable *table, const struct session_conf *conf,
                                       const struct rig *rig, const struct rig_timing *timing) {
    GHashTableIter iter;
    gpointer alike;
    g_hash_table_iter_init(&iter, table);
    while (g_hash_table_iter_next(&iter, NULL, &alike)) {
        sort(alike, timing->turntable.wraps);
        if (!any_in_pass(alike, conf, rig, timing))
            g_array_set_size(alike, 0);
    }
}

GArray *passes_take_followers(GArray *shots, const struct session_conf *conf, const struct rig *rig,
                              const struct rig_timing *timing) {
    GArray *followers = g_array_new(FALSE, FALSE, sizeof(struct session_shot));
    g_autoptr(GHashTable) table = list_alike(shots, rig);
    guint n = 0;
    empty_lists_without_passes(table, conf, rig, timing);
    for (guint i = 0; i < shots->len; i++) {
        struct session_shot shot = g_array_index(shots, struct session_shot, i);
        gboolean follows = FALSE;
        g_autoptr(GArray) alike = take_list(table, &shot, rig, &follows);
        if (follows)
            continue;
        if (alike) {
            shot = g_array_index(alike, struct session_shot, 0);
            g_array_append_vals(followers, &g_array_index(alike, struct session_shot, 1),
                                alike->len - 1);
        }
        g_array_index(shots, struct session_shot, n++) = shot;
    }
    /* The length is not set by g_array_set_size(), because that could free the strings of shots
     * that followers now contains. */
    shots->len = n;
    return followers;
}

void passes_put_back(GArray *shots, GArray *followers, const struct rig *rig) {
    g_autoptr(GArray) all = g_array_new(FALSE, FALSE, sizeof(struct session_shot));
    g_autoptr(GHashTable) table = list_alike(followers, rig);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = &g_array_index(shots, struct session_shot, i);
        gboolean later;
        g_autoptr(GArray) alike = take_list(table, shot, rig, &later);
        g_array_append_vals(all, shot, 1);
        if (alike)
            g_array_append_vals(all, alike->data, alike->len);
    }
    shots->len = 0;
    g_array_append_vals(shots, all->data, all->len);
}
