#include "plan_private.h"

#include <string.h>

/* Maximum number of cost evaluations in the search for a better order. */
#define SEARCH_BUDGET 300000
/* Maximum number of shots of a block whose best order is improved by the search. */
#define SEARCH_LARGEST 1500
/* With at most this number of shots, the search improves every candidate order. With more shots, it
 * improves only the best one. */
#define SEARCH_ALL    40
#define LONGEST_MOVED 8

typedef GArray Order; /* of guint: indices of shots */

static const struct session_shot *shot_at(GArray *shots, guint index) {
    return &g_array_index(shots, struct session_shot, index);
}

static gboolean is_lit(const struct session_shot *shot) {
    return shot->state == SHOT_PLANNED && shot->kind != SHOT_DARK;
}

/* The shots of a pose. Lamps come in order of their indices. Sweeps come in order of the time that
 * they take to prepare, the longest first. */
struct pose_shots {
    GArray *lamps, *sweeps; /* of guint */
};

struct orderer {
    GArray *shots;
    const int *block_of; /* index of the block of each shot */
    int block;           /* the block that is being ordered */
    int before;          /* the last shot of the previous block; −1 if there is none */
    /* the dark shot, which comes before the first shot; NULL if there is none */
    const struct session_shot *dark;
    const struct rig *rig;
    const struct rig_timing *timing;
    struct plan_moves *moves;
    struct pose_shots *poses;
    const double *readout_of_s; /* read-out time of each shot */
    double readout_s;           /* the longest of them in the block */
    /* index of the lamp that is on after the last shot of the order; −1 if no lamp is on */
    int lit;
};

/* Returns whether a shot is planned, not dark, and in the block that is being ordered. */
static gboolean is_ours(const struct orderer *o, guint index) {
    return is_lit(shot_at(o->shots, index)) && o->block_of[index] == o->block;
}

static int compare_lamps(gconstpointer a, gconstpointer b, gpointer data) {
    guint x = *(const guint *)a, y = *(const guint *)b;
    const struct session_shot *s = shot_at(data, x), *t = shot_at(data, y);

    if (s->device != t->device)
        return s->device - t->device;
    return x < y ? -1 : x > y;
}

static int compare_sweeps(gconstpointer a, gconstpointer b, gpointer data) {
    const struct orderer *o = data;
    guint x = *(const guint *)a, y = *(const guint *)b;
    double s = plan_lead_s(NULL, shot_at(o->shots, x), o->rig, o->timing);
    double t = plan_lead_s(NULL, shot_at(o->shots, y), o->rig, o->timing);

    if (s != t)
        return s > t ? -1 : 1;
    return x < y ? -1 : x > y;
}

static void collect(struct orderer *o) {
    int n_poses = o->moves->n;

    o->poses = g_new(struct pose_shots, n_poses);
    for (int p = 0; p < n_poses; p++) {
        o->poses[p].lamps = g_array_new(FALSE, FALSE, sizeof(guint));
        o->poses[p].sweeps = g_array_new(FALSE, FALSE, sizeof(guint));
    }
    for (guint i = 0; i < o->shots->len; i++) {
        const struct session_shot *shot = shot_at(o->shots, i);
        if (!is_ours(o, i))
            continue;
        struct pose_shots *pose = &o->poses[shot->pose];
        // NOLINTNEXTLINE(clang-analyzer-core.CallAndMessage): set for every pose above
        g_array_append_val(shot->kind == SHOT_LAMP ? pose->lamps : pose->sweeps, i);
        o->readout_s = MAX(o->readout_s, o->readout_of_s[i]);
    }
    for (int p = 0; p < n_poses; p++) {
        g_array_sort_with_data(o->poses[p].lamps, compare_lamps, o->shots);
        g_array_sort_with_data(o->poses[p].sweeps, compare_sweeps, o);
    }
}

static void append(struct orderer *o, Order *order, guint index) {
    const struct session_shot *shot = shot_at(o->shots, index);

    g_array_append_val(order, index);
    o->lit = shot->kind == SHOT_LAMP ? shot->device : -1;
}

static void append_sweeps(struct orderer *o, Order *order, const GArray *sweeps) {
    for (guint i = 0; i < sweeps->len; i++)
        append(o, order, g_array_index(sweeps, guint, i));
}

/* Returns the time that the first of some shots takes to prepare, or 0 if there are no shots. */
static double first_lead_s(const struct orderer *o, const GArray *indices) {
    return indices->len ? plan_lead_s(NULL, shot_at(o->shots, g_array_index(indices, guint, 0)),
                                      o->rig, o->timing)
                        : 0;
}

/* Appends the shots of a pose. Sweeps or lamps come first, whichever take longer to prepare,
 * because the first shot is prepared during the move. Lamps come in ascending order, or in
 * descending order if the last of them is still on from the previous pose. */
static void append_pose(struct orderer *o, Order *order, const struct pose_shots *shots) {
    const GArray *lamps = shots->lamps;
    const gboolean sweeps_first = first_lead_s(o, shots->sweeps) >= first_lead_s(o, lamps);

    if (sweeps_first)
        append_sweeps(o, order, shots->sweeps);
    const guint n = lamps->len;
    const gboolean down =
        n > 0 && shot_at(o->shots, g_array_index(lamps, guint, n - 1))->device == o->lit;
    for (guint i = 0; i < n; i++)
        append(o, order, g_array_index(lamps, guint, down ? n - 1 - i : i));
    if (!sweeps_first)
        append_sweeps(o, order, shots->sweeps);
}

/* Makes an order that takes all shots of a pose before those of the next pose. */
static void order_by_poses(struct orderer *o, Order *order) {
    g_autofree int *poses = g_new(int, o->moves->n);
    int n = 0;

    for (int p = 0; p < o->moves->n; p++)
        // NOLINTNEXTLINE(clang-analyzer-core.NullDereference): collect() made them all
        if (o->poses[p].lamps->len + o->poses[p].sweeps->len > 0)
            poses[n++] = p;
    plan_tour(o->moves, poses, n, o->readout_s);
    o->lit = -1;
    for (int i = 0; i < n; i++)
        append_pose(o, order, &o->poses[poses[i]]);
}

/* Returns, for each lamp of the rig, the poses (GArray of int, ascending) with a shot of the lamp.
 */
static GPtrArray *poses_of_lamps(const struct orderer *o) {
    GPtrArray *ret = g_ptr_array_new_with_free_func((GDestroyNotify)g_array_unref);

    for (int lamp = 0; lamp < o->rig->n_lamps; lamp++)
        g_ptr_array_add(ret, g_array_new(FALSE, FALSE, sizeof(int)));
    for (int p = 0; p < o->moves->n; p++)
        for (guint i = 0; i < o->poses[p].lamps->len; i++) {
            const guint index = g_array_index(o->poses[p].lamps, guint, i);
            GArray *poses = ret->pdata[shot_at(o->shots, index)->device];
            if (poses->len == 0 || g_array_index(poses, int, poses->len - 1) != p)
                g_array_append_val(poses, p);
        }
    return ret;
}

/* Returns the lamp that is needed in most of the poses with sweeps, or −1 if there is none. */
static int lamp_beside_sweeps(const struct orderer *o) {
    g_autoptr(GPtrArray) poses_of = poses_of_lamps(o);
    int best = -1, most = 0;

    for (guint lamp = 0; lamp < poses_of->len; lamp++) {
        const GArray *poses = poses_of->pdata[lamp];
        int n = 0;
        for (guint i = 0; i < poses->len; i++)
            n += o->poses[g_array_index(poses, int, i)].sweeps->len > 0;
        if (n > most) {
            most = n;
            best = (int)lamp;
        }
    }
    return best;
}

/* Makes an order that takes the shots of one lamp in all poses before those of the next lamp. This
 * is the quickest order if lamps take longer to warm up than axes take to move. beside is
 * the index of a lamp, or −1. The sweeps of a pose are taken next to its shot with that lamp. The
 * sweeps of poses without that lamp come at the end. If beside is −1, all sweeps come at the
 * end. */
static void order_by_lamps(struct orderer *o, Order *order, int beside) {
    g_autofree int *left = g_new(int, o->moves->n); /* poses whose sweeps come at the end */
    g_autofree gboolean *is_beside = g_new0(gboolean, o->moves->n);
    g_autoptr(GPtrArray) poses_of = poses_of_lamps(o);

    for (int lamp = 0; lamp < o->rig->n_lamps; lamp++) {
        const GArray *with_lamp = poses_of->pdata[lamp];
        int *poses = (int *)(gpointer)with_lamp->data;
        plan_tour(o->moves, poses, (int)with_lamp->len, o->readout_s);
        for (guint k = 0; k < with_lamp->len; k++) {
            const struct pose_shots *shots = &o->poses[poses[k]];
            is_beside[poses[k]] |= lamp == beside;
            for (guint i = 0; i < shots->lamps->len; i++) {
                guint index = g_array_index(shots->lamps, guint, i);
                if (shot_at(o->shots, index)->device == lamp)
                    append(o, order, index);
            }
            if (lamp == beside)
                append_sweeps(o, order, shots->sweeps);
        }
    }
    int n = 0;
    for (int p = 0; p < o->moves->n; p++)
        if (o->poses[p].sweeps->len && !is_beside[p])
            left[n++] = p;
    plan_tour(o->moves, left, n, o->readout_s);
    for (int k = 0; k < n; k++)
        append_sweeps(o, order, o->poses[left[k]].sweeps);
}

static int compare_nested(gconstpointer a, gconstpointer b, gpointer data) {
    const struct orderer *o = data;
    const struct session_shot *s = shot_at(o->shots, *(const guint *)a);
    const struct session_shot *t = shot_at(o->shots, *(const guint *)b);
    const struct plan_pose *p = &o->moves->poses[s->pose], *q = &o->moves->poses[t->pose];
    const gint64 apart[] = {p->turntable_udeg - q->turntable_udeg, p->arm_udeg - q->arm_udeg,
                            p->arc_udeg - q->arc_udeg, p->probe_udeg - q->probe_udeg};

    for (gsize i = 0; i < G_N_ELEMENTS(apart); i++)
        if (apart[i] != 0)
            return apart[i] > 0 ? 1 : -1;
    if (s->kind != t->kind)
        return s->kind > t->kind ? 1 : -1;
    return compare_lamps(a, b, o->shots);
}

static void order_nested(const struct orderer *o, Order *order) {
    for (guint i = 0; i < o->shots->len; i++)
        if (is_ours(o, i))
            g_array_append_val(order, i);
    g_array_sort_with_data(order, compare_nested, (gpointer)o);
}

/* Returns copies of the shots in the given order. Dark shots come first and get the pose of the
 * first shot. Skipped shots come last. */
static GArray *arranged(GArray *shots, const Order *order) {
    GArray *result = g_array_new(FALSE, FALSE, sizeof(struct session_shot));

    for (guint i = 0; i < shots->len; i++) {
        struct session_shot shot = *shot_at(shots, i);
        if (shot.kind != SHOT_DARK)
            continue;
        if (order->len) {
            const struct session_shot *first = shot_at(shots, g_array_index(order, guint, 0));
            shot.turntable_deg = first->turntable_deg;
            shot.arc_deg = first->arc_deg;
            shot.pose = first->pose;
        }
        g_array_append_val(result, shot);
    }
    for (guint i = 0; i < order->len; i++)
        g_array_append_vals(result, shot_at(shots, g_array_index(order, guint, i)), 1);
    for (guint i = 0; i < shots->len; i++)
        if (shot_at(shots, i)->state != SHOT_PLANNED)
            g_array_append_vals(result, shot_at(shots, i), 1);
    return result;
}

/* Returns the cost of a step of a path (struct plan_path): the time in seconds between the end of
 * one shot's exposures and the start of the next. The step to the first shot (from = −1) begins at
 * the last shot of the previous block or, if there is none, at the dark shot, which is taken in the
 * same pose. The step from the last shot (to = −1) is its read-out. */
static double between(gconstpointer data, int from, int to) {
    const struct orderer *o = data;

    if (from < 0 && to < 0)
        return 0;
    if (to < 0)
        return o->readout_of_s[from];
    const struct session_shot *next = shot_at(o->shots, (guint)to);
    if (from < 0)
        from = o->before;
    if (from < 0)
        return plan_lead_s(o->dark, next, o->rig, o->timing);
    const struct session_shot *before = shot_at(o->shots, (guint)from);
    double move_s = plan_move_s(o->moves, before->pose, next->pose);
    /* plan_lead_s(), with the read-out time that is known already */
    double lead_s = MAX(plan_light_s(before, next, o->rig, o->timing), o->readout_of_s[from]);
    return MAX(move_s, lead_s);
}

static struct plan_path path_of(const struct orderer *o, Order *order) {
    return (struct plan_path){.order = (int *)(gpointer)order->data,
                              .n = (int)order->len,
                              .cost = between,
                              .data = o,
                              .longest_moved = LONGEST_MOVED};
}

static Order *ordered(struct orderer *o, int candidate) {
    Order *order = g_array_new(FALSE, FALSE, sizeof(guint));

    if (candidate == 0)
        order_by_poses(o, order);
    else if (candidate == 1)
        order_by_lamps(o, order, -1);
    else if (candidate == 2)
        order_by_lamps(o, order, lamp_beside_sweeps(o));
    else
        order_nested(o, order);
    if (order->len <= SEARCH_ALL) {
        struct plan_path path = path_of(o, order);
        plan_path_improve(&path, SEARCH_BUDGET);
    }
    return order;
}

static Order *best_of_block(struct orderer *o) {
    Order *best = NULL;
    double best_s = G_MAXDOUBLE;

    for (int candidate = 0; candidate < 4; candidate++) {
        g_autoptr(GArray) order = ordered(o, candidate);
        struct plan_path path = path_of(o, order);
        double cost_s = plan_path_cost(&path);
        if (cost_s < best_s - 1e-9) {
            best_s = cost_s;
            g_clear_pointer(&best, g_array_unref);
            best = g_steal_pointer(&order);
        }
    }
    struct plan_path path = path_of(o, best);
    if (best->len <= SEARCH_LARGEST)
        plan_path_improve(&path, SEARCH_BUDGET);
    return best;
}

static Order *nested_of_block(struct orderer *o) {
    Order *order = g_array_new(FALSE, FALSE, sizeof(guint));

    order_nested(o, order);
    return order;
}

/* Returns an order of all shots: orders each block with order_block(), and concatenates the
 * blocks. */
static Order *in_blocks(struct orderer *o, const int *block_of, int n_blocks,
                        Order *(*order_block)(struct orderer *o)) {
    Order *whole = g_array_new(FALSE, FALSE, sizeof(guint));

    o->block_of = block_of;
    o->before = -1;
    for (o->block = 0; o->block < n_blocks; o->block++) {
        collect(o);
        g_autoptr(GArray) order = order_block(o);
        g_array_append_vals(whole, order->data, order->len);
        if (order->len)
            o->before = (int)g_array_index(order, guint, order->len - 1);
        for (int p = 0; p < o->moves->n; p++) {
            g_array_unref(o->poses[p].lamps);
            g_array_unref(o->poses[p].sweeps);
        }
        g_clear_pointer(&o->poses, g_free);
    }
    o->before = -1;
    return whole;
}

/* Sets the block of each shot, and returns the number of blocks, which is the largest number of
 * places at which any laser unit is needed. The sweeps of a unit's n-th place are in block n. Every
 * unit is therefore mounted only once at each place. All other shots are in the first block. */
static int block_by_mount(GArray *shots, const struct rig_timing *timing, int *block_of) {
    int rank[RIG_MAX_LASERS] = {0}, n_blocks = 1;
    guint32 used = 0;

    for (guint i = 0; i < shots->len; i++)
        if (is_lit(shot_at(shots, i)) && shot_at(shots, i)->kind == SHOT_SWEEP)
            used |= 1u << shot_at(shots, i)->device;
    for (int laser = 0; laser < RIG_MAX_LASERS; laser++) {
        int unit = rig_laser_unit(timing, laser);
        guint32 places = timing->mounts[unit] | 1u << unit;
        rank[laser] = __builtin_popcount(places & used & ((1u << laser) - 1));
        if (used & 1u << laser)
            n_blocks = MAX(n_blocks, rank[laser] + 1);
    }
    for (guint i = 0; i < shots->len; i++)
        block_of[i] = shot_at(shots, i)->kind == SHOT_SWEEP ? rank[shot_at(shots, i)->device] : 0;
    return n_blocks;
}

static void keep_quicker(const struct orderer *o, Order **best, Order *order) {
    struct plan_path ours = path_of(o, order), known = path_of(o, *best);
    gboolean quicker = plan_path_cost(&ours) < plan_path_cost(&known) - 1e-9;

    g_array_unref(quicker ? *best : order);
    if (quicker)
        *best = order;
}

/* Returns the quickest of up to four orders. If there are several blocks, the first two orders have
 * all lamps in the first block. In one of them each block has its best order, and in the other its
 * nested order. The last two orders distribute the lamps over the blocks in two ways. */
static Order *best_order(struct orderer *o, int n_blocks, int *block_of) {
    GArray *shots = o->shots;
    Order *best = in_blocks(o, block_of, n_blocks, best_of_block);

    if (n_blocks == 1)
        return best;
    keep_quicker(o, &best, in_blocks(o, block_of, n_blocks, nested_of_block));

    /* The lamps of a pose are in the last block that has a sweep in this pose. */
    g_autofree int *last = g_new0(int, o->moves->n);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shot_at(shots, i);
        if (is_lit(shot) && shot->kind == SHOT_SWEEP)
            last[shot->pose] = MAX(last[shot->pose], block_of[i]);
    }
    for (guint i = 0; i < shots->len; i++)
        if (shot_at(shots, i)->kind == SHOT_LAMP)
            block_of[i] = last[shot_at(shots, i)->pose];
    keep_quicker(o, &best, in_blocks(o, block_of, n_blocks, best_of_block));

    /* The lamps are distributed over the blocks, so that every block visits the poses with other
     * lamps. This is quick if lamps take long to warm up. */
    for (guint i = 0; i < shots->len; i++)
        if (shot_at(shots, i)->kind == SHOT_LAMP)
            block_of[i] = shot_at(shots, i)->device % n_blocks;
    keep_quicker(o, &best, in_blocks(o, block_of, n_blocks, best_of_block));
    return best;
}

/* Puts shots into the order `wanted`, and replaces the indices of their poses by numbers of visits.
 * passed is NULL or contains the shots that passes_take_followers() has removed. These shots are
 * put back. Returns the number of visits. */
static int order_with(GArray *shots, GArray *passed, const struct plan_pose *poses, int n_poses,
                      const struct rig *rig, const struct rig_timing *timing,
                      enum session_order wanted) {
    struct orderer o = {.shots = shots, .rig = rig, .timing = timing, .before = -1};
    g_autofree int *block_of = g_new0(int, shots->len);
    g_autofree double *readout_of_s = g_new(double, shots->len + 1);
    const int n_blocks = block_by_mount(shots, timing, block_of);
    int visit = -1, pose = -1;

    for (guint i = 0; i < shots->len; i++) {
        readout_of_s[i] = plan_readout_s(shot_at(shots, i), timing);
        if (shot_at(shots, i)->kind == SHOT_DARK)
            o.dark = shot_at(shots, i);
    }
    o.readout_of_s = readout_of_s;
    o.moves = plan_moves_new(poses, n_poses, timing);
    g_autoptr(GArray) order = wanted == ORDER_VIEWS
                                  ? in_blocks(&o, block_of, n_blocks, nested_of_block)
                                  : best_order(&o, n_blocks, block_of);
    plan_moves_free(o.moves);

    /* result has the same shots in another order. Their strings are not copied. */
    g_autoptr(GArray) result = arranged(shots, order);
    g_assert(shots->len == result->len);
    memcpy(shots->data, result->data, result->len * sizeof(struct session_shot));
    if (passed)
        passes_put_back(shots, passed, rig);

    /* Replaces the indices of poses by the numbers of visits. */
    for (guint i = 0; i < shots->len; i++) {
        struct session_shot *shot = &g_array_index(shots, struct session_shot, i);
        if (shot->pose != pose)
            visit++;
        pose = shot->pose;
        shot->pose = visit;
    }
    return visit + 1;
}

int plan_order_standing(GArray *shots, const struct plan_pose *poses, int n_poses,
                        const struct rig *rig, const struct rig_timing *timing,
                        enum session_order wanted) {
    return order_with(shots, NULL, poses, n_poses, rig, timing, wanted);
}

/* Sets the passes of shots in their order. Returns the predicted time without homing. */
static double passing_order_s(GArray *shots, const struct session_conf *conf, const struct rig *rig,
                              const struct rig_timing *timing) {
    double first_s;

    plan_set_passes(shots, conf, rig, timing, 0);
    const double s = plan_total_s(shots, conf, rig, timing, &first_s);
    return s + first_s;
}

int plan_order(GArray *shots, const struct plan_pose *poses, int n_poses,
               const struct session_conf *conf, const struct rig *rig,
               const struct rig_timing *timing) {
    g_autoptr(GArray) other = g_array_new(FALSE, FALSE, sizeof(struct session_shot));
    if (conf->motion != MOTION_CONTINUOUS)
        return order_with(shots, NULL, poses, n_poses, rig, timing, conf->order);

    g_array_append_vals(other, shots->data, shots->len);
    g_autoptr(GArray) passed = passes_take_followers(other, conf, rig, timing);
    const gboolean some = passed->len > 0;
    const int other_visits =
        some ? order_with(other, passed, poses, n_poses, rig, timing, conf->order) : 0;
    const double other_s = some ? passing_order_s(other, conf, rig, timing) : G_MAXDOUBLE;
    const int visits = order_with(shots, NULL, poses, n_poses, rig, timing, conf->order);
    if (passing_order_s(shots, conf, rig, timing) <= other_s)
        return visits;
    /* other has the same shots in another order. Their strings are not copied. */
    memcpy(shots->data, other->data, other->len * sizeof(struct session_shot));
    return other_visits;
}
