#include "multiplexed.h"

#include "base/plural.h"

#include <math.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
/* Reflectance of the grey at which the noise is kept, and of the white that must not saturate. */
#define GREY  0.18
#define WHITE 1.0
/* Part of full scale from which a pixel counts as saturated (intake/radiance.h). */
#define FULL 0.98
/* Pictures of a group that wait in the intake, of all cameras. */
#define MOST_BYTES ((guint64)1 << 30)
/* Parts of exposures are rounded up to this. */
#define PART_STEP 1e-3

/* Shots of lamps in one pose, by the same cameras. */
struct place {
    int pose;
    guint32 cameras;
    GArray *shots; /* of int, indices of b->shots, in order of lamps; each lamp once */
};

static void multiplexed_place_clear(gpointer data) {
    g_array_unref(((struct place *)data)->shots);
}

static int multiplexed_compare(gconstpointer a, gconstpointer b, gpointer data) {
    const GArray *shots = data;
    return g_array_index(shots, struct session_shot, *(const int *)a).device -
           g_array_index(shots, struct session_shot, *(const int *)b).device;
}

static struct place *multiplexed_find(GArray *places, const struct session_shot *shot) {
    for (guint i = places->len; i > 0; i--) { /* the shots of a pose are next to each other */
        struct place *place = &g_array_index(places, struct place, i - 1);
        if (place->pose == shot->pose && place->cameras == shot->cameras)
            return place;
    }
    const struct place place = {shot->pose, shot->cameras, g_array_new(FALSE, FALSE, sizeof(int))};
    g_array_append_val(places, place);
    return &g_array_index(places, struct place, places->len - 1);
}

static GArray *multiplexed_places(const struct multiplexed_setup *b) {
    GArray *places = g_array_new(FALSE, FALSE, sizeof(struct place));
    g_array_set_clear_func(places, multiplexed_place_clear);
    for (int i = 0; i < (int)b->shots->len; i++) {
        const struct session_shot *shot = &g_array_index(b->shots, struct session_shot, i);
        if (shot->kind != SHOT_LAMP || shot->state != SHOT_PLANNED)
            continue;
        GArray *shots = multiplexed_find(places, shot)->shots;
        gboolean known = FALSE;
        for (guint k = 0; k < shots->len; k++)
            known |=
                g_array_index(b->shots, struct session_shot, g_array_index(shots, int, k)).device ==
                shot->device;
        if (!known)
            g_array_append_val(shots, i);
    }
    for (guint i = 0; i < places->len; i++)
        g_array_sort_with_data(g_array_index(places, struct place, i).shots, multiplexed_compare,
                               b->shots);
    return places;
}

/* DN/ms above dark that a camera sees of a white diffuser in the middle of the sample, under the
 * mean of the lamps that it takes pictures with; 0: none. */
static double multiplexed_white(const struct multiplexed_setup *b, const struct rig *rig,
                                int camera) {
    const struct vec3 middle = vec3(0, 0, b->reference_mm);
    double sum = 0;
    int n = 0;
    for (guint i = 0; i < b->shots->len; i++) {
        const struct session_shot *shot = &g_array_index(b->shots, struct session_shot, i);
        if (shot->kind != SHOT_LAMP || shot->state != SHOT_PLANNED ||
            !(shot->cameras >> camera & 1))
            continue;
        const struct rig_lamp *lamp = &rig->lamps[shot->device];
        const double arc_rad = RAD(shot->arc_deg);
        const struct vec3 towards =
            vec3_unit(vec3_sub(rig_lamp_position_mm(&rig->arc, lamp, arc_rad), middle));
        sum += rig_lamp_irradiance(&rig->arc, lamp, arc_rad, middle) * MAX(towards.z, 0);
        n++;
    }
    return n > 0 ? rig->cameras[camera].response * WHITE / G_PI * sum / n * 1e-3 : 0;
}

/* The noise that the cameras are expected to have, before a choice. */
struct expected {
    int n_cameras;
    struct {
        double grey;         /* DN/ms */
        double floor, slope; /* variance of the grey: read noise, and photons */
        double most_ms;      /* longest shortest exposure of the white without saturation */
    } cameras[RIG_MAX_CAMERAS];
};

static gboolean multiplexed_expect(const struct multiplexed_setup *b, struct expected *ret) {
    const struct rig *rig = b->calibration ? &b->calibration->rig : b->rig;
    double sum_ms = 0;
    *ret = (struct expected){0};
    for (int i = 0; i < b->n_exposures; i++)
        sum_ms += b->exposures_us[i] * 1e-3;
    for (int c = 0; c < b->rig->n_cameras; c++) {
        const double white = multiplexed_white(b, rig, c), grey = white * GREY / WHITE;
        if (white <= 0)
            continue;
        if (!b->calibration || !b->calibration->noise[c].known)
            return FALSE;
        const struct transfer *transfer = &b->calibration->noise[c].transfer;
        const double top = ((1 << b->timing->bits[c]) - 1) * FULL - transfer->black_dn;
        double floor, slope;
        transfer_noise(transfer, sum_ms, b->n_exposures, &floor, &slope);
        const int k = ret->n_cameras++;
        ret->cameras[k].grey = grey;
        ret->cameras[k].floor = floor;
        ret->cameras[k].slope = slope * grey;
        ret->cameras[k].most_ms = top / white * pow(10, -b->gain_db / 20);
    }
    return ret->n_cameras > 0;
}

static double multiplexed_part(const struct expected *e, int n) {
    double part = 0;
    for (int c = 0; c < e->n_cameras; c++)
        part = MAX(part, multiplex_part(n, e->cameras[c].floor, e->cameras[c].slope));
    return ceil(part / PART_STEP) * PART_STEP;
}

/* The expected noise of the grey relative to its value, of the noisiest camera. */
static double multiplexed_noise_pct(const struct expected *e, int n, double part) {
    double most = 0;
    for (int c = 0; c < e->n_cameras; c++)
        most = MAX(
            most, sqrt(multiplex_part_variance(n, part, e->cameras[c].floor, e->cameras[c].slope)) /
                      e->cameras[c].grey);
    return 100 * most;
}

/* Whether a pattern's white is bright enough to saturate the shortest exposure. */
static gboolean multiplexed_saturates(const struct expected *e, int n, double shortest_ms) {
    for (int c = 0; c < e->n_cameras; c++)
        if ((n + 1) / 2.0 * shortest_ms > e->cameras[c].most_ms)
            return TRUE;
    return FALSE;
}

/* Exposures of all shots in units of those of one lamp alone. */
static double multiplexed_cost(const GArray *places, int n, double part) {
    double sum = 0;
    for (guint i = 0; i < places->len; i++) {
        const int lamps = (int)g_array_index(places, struct place, i).shots->len;
        const int alone = lamps % n;
        sum += (lamps - alone) * part + alone;
    }
    return sum;
}

/* The least part that all cameras can be exposed for. */
static double multiplexed_least_part(const struct multiplexed_setup *b) {
    double least = 0;
    for (int c = 0; c < b->rig->n_cameras; c++)
        least = MAX(least, (double)b->timing->min_exposure_us[c] / b->exposures_us[0]);
    return MIN(ceil(least / PART_STEP) * PART_STEP, 1);
}

/* Lamps that may be in a group, by the poses, the supply and the memory. */
static int multiplexed_most(const struct multiplexed_setup *b, const GArray *places) {
    guint64 bytes = 0;
    int lamps = 0;
    for (guint i = 0; i < places->len; i++)
        lamps = MAX(lamps, (int)g_array_index(places, struct place, i).shots->len);
    for (int c = 0; c < b->rig->n_cameras; c++)
        bytes += (guint64)b->rig->cameras[c].width * (guint64)b->rig->cameras[c].height * 4;
    const int by_supply = 2 * MAX(b->timing->lamps_at_once, 1) - 1;
    const int by_memory = (int)MIN(MOST_BYTES / MAX(bytes, 1), G_MAXINT);
    return multiplex_order(MIN(lamps, MIN(by_supply, by_memory)));
}

/* Why a number of lamps is not possible; NULL: it is. */
static char *multiplexed_refuse(const struct multiplexed_setup *b, const GArray *places) {
    const int n = b->wanted, most = multiplexed_most(b, places);
    int lamps = 0;
    for (guint i = 0; i < places->len; i++)
        lamps = MAX(lamps, (int)g_array_index(places, struct place, i).shots->len);
    if (n <= most)
        return NULL;
    if (n > lamps)
        return g_strdup_printf("%d lamps cannot be lit at once: at most %d light the sample in the "
                               "same pose; give as many at most, or no",
                               n, lamps);
    if ((n + 1) / 2 > MAX(b->timing->lamps_at_once, 1))
        return g_strdup_printf("groups of %d lamps need %d of them lit at once, and the rig file "
                               "allows %d: [rig] lamps_at_once says how many their supply can feed",
                               n, (n + 1) / 2, MAX(b->timing->lamps_at_once, 1));
    return g_strdup_printf("pictures of %d lamps of these cameras take more than 1 GiB of memory; "
                           "give %d at most",
                           n, most);
}

/* The order for auto; 0: one lamp at a time, and *ret_why says why. */
static int multiplexed_best(const struct multiplexed_setup *b, const GArray *places,
                            const struct expected *e, char **ret_why) {
    const int most = multiplexed_most(b, places);
    const double least = multiplexed_least_part(b);
    double best_cost = multiplexed_cost(places, 1, 1), least_part = G_MAXDOUBLE;
    int best = 0, nearest = 0;
    gboolean bright = FALSE;
    if (most == 0) {
        *ret_why = b->timing->lamps_at_once < 2
                       ? g_strdup("the rig file does not allow more ([rig] lamps_at_once)")
                       : g_strdup("no pose has three lamps that may be lit at once");
        return 0;
    }
    for (int n = most; n > 0; n = multiplex_order(n - 1)) {
        const double part = multiplexed_part(e, n), used = MAX(part, least);
        const double cost = multiplexed_cost(places, n, used);
        if (part < least_part) {
            least_part = part;
            nearest = n;
        }
        if (used >= 1 || cost >= best_cost)
            continue;
        if (multiplexed_saturates(e, n, b->exposures_us[0] * 1e-3 * used)) {
            bright = TRUE;
            continue;
        }
        best = n;
        best_cost = cost;
    }
    if (best == 0 && bright)
        *ret_why = g_strdup("a white sample under several lamps would saturate the shortest of "
                            "exposures_us");
    else if (best == 0)
        *ret_why = g_strdup_printf(
            "photons make most of the noise: for the same noise of a grey of %g %%, "
            "groups of %d lamps need %.2f times the exposure",
            100 * GREY, nearest, least_part);
    return best;
}

void multiplexed_apply(const struct multiplexed_setup *setup, struct multiplexed_choice *choice) {
    g_autoptr(GArray) places = multiplexed_places(setup);
    struct session_shot *group[MULTIPLEX_MOST];
    const int n = choice->n;
    choice->groups = 0;
    for (guint i = 0; i < places->len; i++) {
        const GArray *shots = g_array_index(places, struct place, i).shots;
        for (int first = 0; first + n <= (int)shots->len; first += n) {
            choice->groups++;
            for (int k = 0; k < n; k++) {
                group[k] = &g_array_index(setup->shots, struct session_shot,
                                          g_array_index(shots, int, first + k));
                group[k]->multiplex = (struct session_multiplex){
                    .group = choice->groups, .n = n, .k = k, .part = choice->part};
            }
            session_light_multiplexed(group, n);
        }
    }
    for (guint i = 0; i < setup->shots->len; i++) {
        struct session_shot *shot = &g_array_index(setup->shots, struct session_shot, i);
        if (shot->kind == SHOT_DARK)
            shot->multiplex.part = choice->part;
    }
}

void multiplexed_undo(GArray *shots, struct multiplexed_choice *choice, const char *why) {
    for (guint i = 0; i < shots->len; i++)
        g_array_index(shots, struct session_shot, i).multiplex = (struct session_multiplex){0};
    *choice = (struct multiplexed_choice){.why = g_strdup(why)};
}

gboolean multiplexed_choose(const struct multiplexed_setup *setup, struct multiplexed_choice *ret,
                            char **ret_why) {
    struct expected expected;
    *ret = (struct multiplexed_choice){0};
    if (setup->wanted == MULTIPLEX_NO)
        return TRUE;
    g_autoptr(GArray) places = multiplexed_places(setup);
    if (setup->wanted != MULTIPLEX_AUTO && (*ret_why = multiplexed_refuse(setup, places)))
        return FALSE;
    const gboolean known = multiplexed_expect(setup, &expected);
    if (setup->wanted != MULTIPLEX_AUTO)
        ret->n = setup->wanted;
    else if (known)
        ret->n = multiplexed_best(setup, places, &expected, &ret->why);
    else
        ret->why = g_strdup("the noise of the cameras is not known; mesorig calibrate radiometry "
                            "measures it, and [rig] calibration names the file");
    if (ret->n == 0)
        return TRUE;
    ret->part =
        known ? CLAMP(multiplexed_part(&expected, ret->n), multiplexed_least_part(setup), 1) : 1;
    ret->noise_pct = known ? multiplexed_noise_pct(&expected, ret->n, ret->part) : 0;
    ret->alone_pct = known ? multiplexed_noise_pct(&expected, 1, 1) : 0;
    ret->bright = known && multiplexed_saturates(&expected, ret->n,
                                                 setup->exposures_us[0] * 1e-3 * ret->part);
    return TRUE;
}

char *multiplexed_note(const struct multiplexed_choice *choice, double multiplexed_s,
                       double alone_s) {
    const int n = choice->n;
    if (n == 0)
        return g_strdup_printf("[lights] multiplex = auto: one lamp at a time, since %s",
                               choice->why);
    g_autoptr(GString) text = g_string_new(NULL);
    g_string_append_printf(text,
                           "[lights] multiplex: %d %s of %d lamps, of which %d are lit at once, "
                           "exposed for %g of exposures_us; the session takes %.1f s, and with one "
                           "lamp at a time %.1f s",
                           PLURAL(choice->groups, "group"), n, (n + 1) / 2, choice->part,
                           multiplexed_s, alone_s);
    if (choice->alone_pct > 0)
        g_string_append_printf(text,
                               "; expected noise of a grey of %g %% in a pixel: %.3g %% of its "
                               "value, and with one lamp at a time %.3g %%",
                               100 * GREY, choice->noise_pct, choice->alone_pct);
    else
        g_string_append(text, "; what it does to the noise is not known, since the cameras' is not "
                              "calibrated");
    if (choice->bright)
        g_string_append(text, "; a white sample would saturate the shortest exposure, and is then "
                              "taken with a quarter of it");
    return g_string_free(g_steal_pointer(&text), FALSE);
}

static gboolean multiplexed_follows(const struct session_shot *shot) {
    return shot->multiplex.group > 0 && shot->multiplex.k > 0;
}

static int multiplexed_compare_followers(gconstpointer a, gconstpointer b) {
    const struct session_multiplex *s = &((const struct session_shot *)a)->multiplex;
    const struct session_multiplex *t = &((const struct session_shot *)b)->multiplex;
    return s->group != t->group ? s->group - t->group : s->k - t->k;
}

GArray *multiplexed_take_followers(GArray *shots) {
    GArray *followers = g_array_new(FALSE, FALSE, sizeof(struct session_shot));
    guint n = 0;
    for (guint i = 0; i < shots->len; i++) {
        struct session_shot *shot = &g_array_index(shots, struct session_shot, i);
        if (multiplexed_follows(shot))
            g_array_append_vals(followers, shot, 1);
        else
            g_array_index(shots, struct session_shot, n++) = *shot;
    }
    shots->len = n; /* what the shots own stays theirs: not g_array_set_size() */
    g_array_sort(followers, multiplexed_compare_followers);
    return followers;
}

void multiplexed_put_back(GArray *shots, GArray *followers) {
    g_autofree struct session_shot *leaders =
        g_memdup2(shots->data, shots->len * sizeof(struct session_shot));
    g_autoptr(GHashTable) first_of = g_hash_table_new(NULL, NULL); /* group → index + 1 */
    const guint n_leaders = shots->len;
    for (guint i = followers->len; i > 0; i--)
        g_hash_table_insert(
            first_of,
            GINT_TO_POINTER(g_array_index(followers, struct session_shot, i - 1).multiplex.group),
            GUINT_TO_POINTER(i));
    shots->len = 0;
    for (guint i = 0; i < n_leaders; i++) {
        const int group = leaders[i].multiplex.group;
        guint k =
            group > 0 ? GPOINTER_TO_UINT(g_hash_table_lookup(first_of, GINT_TO_POINTER(group))) : 0;
        g_array_append_vals(shots, &leaders[i], 1);
        for (; k > 0 && k <= followers->len; k++) {
            struct session_shot follower = g_array_index(followers, struct session_shot, k - 1);
            if (follower.multiplex.group != group)
                break;
            follower.pose = leaders[i].pose;
            g_array_append_vals(shots, &follower, 1);
        }
    }
}

char *multiplexed_refused(const GPtrArray *shots, const struct rig_timing *timing) {
    const int most = MAX(timing->lamps_at_once, 1);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_multiplex *t =
            &((const struct session_shot *)shots->pdata[i])->multiplex;
        const int lit = __builtin_popcountll(t->lit[0]) + __builtin_popcountll(t->lit[1]);
        if (lit > most)
            return g_strdup_printf("%d lamps are lit at once in this session, and the rig file "
                                   "allows %d: [rig] lamps_at_once says how many their supply can "
                                   "feed",
                                   lit, most);
    }
    return NULL;
}

gboolean multiplexed_parse(const char *text, int *ret_wanted, char **ret_why) {
    char *end = NULL;
    *ret_wanted = g_str_equal(text, "no") ? MULTIPLEX_NO : MULTIPLEX_AUTO;
    if (g_str_equal(text, "no") || g_str_equal(text, "auto"))
        return TRUE;
    const gint64 n = g_ascii_isdigit(*text) ? g_ascii_strtoll(text, &end, 10) : 0;
    *ret_wanted = (int)CLAMP(n, 0, MULTIPLEX_MOST + 1);
    int above = MAX(*ret_wanted, MULTIPLEX_LEAST);
    while (above < MULTIPLEX_MOST && multiplex_order(above) < *ret_wanted)
        above++;
    if (!end || *end || n < MULTIPLEX_LEAST || n > MULTIPLEX_MOST)
        *ret_why = g_strdup_printf("\"%s\" is not no, auto, or a number of lamps from %d to %d",
                                   text, MULTIPLEX_LEAST, MULTIPLEX_MOST);
    else if (above != (int)n)
        *ret_why = g_strdup_printf("there are no patterns for groups of %d lamps; take %d or %d",
                                   (int)n, multiplex_order((int)n), above);
    return *ret_why == NULL;
}

/* Which lamps (units) are lit in the first frame of a shot of a lamp, or in its last. */
static void multiplexed_units(const struct session_shot *shot, gboolean last, const struct rig *rig,
                              gboolean *ret_lit) {
    const struct session_multiplex *t = &shot->multiplex;
    memset(ret_lit, 0, sizeof(gboolean) * RIG_MAX_LAMPS);
    for (int i = 0; i < rig->n_lamps; i++) {
        const guint64 lit =
            last && session_ends_group(shot) ? t->all[i / 64] & ~t->lit[i / 64] : t->lit[i / 64];
        if (t->group > 0 ? (lit >> i % 64 & 1) != 0 : shot->device == i)
            ret_lit[rig_lamp_unit(rig, i)] = TRUE;
    }
}

double multiplexed_warm_up_s(const struct session_shot *previous, const struct session_shot *shot,
                             const struct rig *rig, const struct rig_timing *timing) {
    gboolean before[RIG_MAX_LAMPS] = {0}, next[RIG_MAX_LAMPS];
    double longest_s = 0;
    const gboolean lit = previous && previous->kind == SHOT_LAMP;
    if (shot->multiplex.group == 0 && (!lit || previous->multiplex.group == 0))
        return lit && rig_lamp_unit(rig, previous->device) == rig_lamp_unit(rig, shot->device)
                   ? 0
                   : timing->lamp_warm_up_s[shot->device];
    if (lit)
        multiplexed_units(previous, TRUE, rig, before);
    multiplexed_units(shot, FALSE, rig, next);
    for (int i = 0; i < rig->n_lamps; i++)
        if (next[i] && !before[i])
            longest_s = MAX(longest_s, timing->lamp_warm_up_s[i]);
    return longest_s;
}

double multiplexed_check_s(const struct session_shot *shot, const struct rig_timing *timing) {
    double longest_s = 0;
    for (int i = 0; i < RIG_MAX_LAMPS && session_ends_group(shot); i++)
        if ((shot->multiplex.all[i / 64] & ~shot->multiplex.lit[i / 64]) >> i % 64 & 1)
            longest_s = MAX(longest_s, timing->lamp_warm_up_s[i]);
    return longest_s;
}
