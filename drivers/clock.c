#include "clock.h"

struct call {
    gint64 at_us;
    guint id;
    ClockFunc func;
    gpointer data;
};

struct Clock {
    gint ref_count;
    gboolean is_virtual, is_lockstep;
    gint64 now_us; /* only for a virtual clock */
    gint holds;    /* atomic, because any thread may change it */
    guint last_id;
    GSequence *calls;  /* of struct call, ordered by time, then by request */
    GHashTable *by_id; /* maps an id to a GSequenceIter */
    GSource *source;
};

struct clock_source {
    GSource base;
    Clock *clock;
};

static int compare_calls(gconstpointer a, gconstpointer b, gpointer unused) {
    const struct call *x = a, *y = b;
    if (x->at_us != y->at_us)
        return x->at_us < y->at_us ? -1 : 1;
    return x->id < y->id ? -1 : x->id > y->id;
}

static const struct call *first_call(const Clock *clock) {
    GSequenceIter *iter = g_sequence_get_begin_iter(clock->calls);
    return g_sequence_iter_is_end(iter) ? NULL : g_sequence_get(iter);
}

static gboolean is_due(const Clock *clock) {
    const struct call *call = first_call(clock);
    if (!call)
        return FALSE;
    if (clock->is_virtual)
        return g_atomic_int_get(&clock->holds) == 0;
    return call->at_us <= g_get_monotonic_time();
}

/* A real clock sleeps in poll() until the first call is due. */
static void set_alarm(Clock *clock) {
    const struct call *call = first_call(clock);
    if (!clock->is_virtual)
        g_source_set_ready_time(clock->source, call ? MAX(call->at_us, 0) : -1);
}

static gboolean prepare(GSource *source, gint *timeout) {
    *timeout = -1;
    return is_due(((struct clock_source *)source)->clock);
}

static gboolean check(GSource *source) {
    return is_due(((struct clock_source *)source)->clock);
}

/* Makes one call in each iteration of the main loop, so that sources that the call has made ready
 * run before time jumps on. */
static gboolean dispatch(GSource *source, GSourceFunc unused, gpointer unused_data) {
    g_autoptr(Clock) clock = clock_ref(((struct clock_source *)source)->clock);
    if (!is_due(clock)) {
        set_alarm(clock);
        return G_SOURCE_CONTINUE;
    }
    GSequenceIter *iter = g_sequence_get_begin_iter(clock->calls);
    struct call call = *(struct call *)g_sequence_get(iter);
    g_hash_table_remove(clock->by_id, GUINT_TO_POINTER(call.id));
    g_sequence_remove(iter);
    if (clock->is_virtual)
        clock->now_us = MAX(clock->now_us, call.at_us);
    set_alarm(clock);
    call.func(call.data);
    return G_SOURCE_CONTINUE;
}

static GSourceFuncs source_funcs = {.prepare = prepare, .check = check, .dispatch = dispatch};

static Clock *clock_new(gboolean is_virtual) {
    Clock *clock = g_new0(Clock, 1);
    clock->ref_count = 1;
    clock->is_virtual = is_virtual;
    clock->calls = g_sequence_new(g_free);
    clock->by_id = g_hash_table_new(NULL, NULL);
    clock->source = g_source_new(&source_funcs, sizeof(struct clock_source));
    ((struct clock_source *)clock->source)->clock = clock;
    g_source_set_name(clock->source, "mesorig clock");
    /* A virtual clock has the lowest priority, below idle sources: its time passes only when
     * nothing else is ready. */
    g_source_set_priority(clock->source, is_virtual ? G_PRIORITY_LOW + 1000 : G_PRIORITY_DEFAULT);
    g_source_set_can_recurse(clock->source, TRUE);
    g_source_attach(clock->source, NULL);
    return clock;
}

Clock *clock_new_real(void) {
    return clock_new(FALSE);
}

Clock *clock_new_virtual(void) {
    return clock_new(TRUE);
}

Clock *clock_ref(Clock *clock) {
    g_return_val_if_fail(clock, NULL);
    g_atomic_int_inc(&clock->ref_count);
    return clock;
}

void clock_unref(Clock *clock) {
    if (!clock || !g_atomic_int_dec_and_test(&clock->ref_count))
        return;
    g_source_destroy(clock->source);
    g_source_unref(clock->source);
    g_hash_table_unref(clock->by_id);
    g_sequence_free(clock->calls);
    g_free(clock);
}

gboolean clock_is_virtual(const Clock *clock) {
    return clock->is_virtual;
}

gint64 clock_now_us(const Clock *clock) {
    return clock->is_virtual ? clock->now_us : g_get_monotonic_time();
}

guint clock_call_at(Clock *clock, gint64 at_us, ClockFunc func, gpointer data) {
    g_return_val_if_fail(clock && func, 0);
    struct call *call = g_new0(struct call, 1);
    /* A call that is already late is made after those that were due earlier. */
    call->at_us = clock->is_virtual ? MAX(at_us, clock->now_us) : at_us;
    call->id = ++clock->last_id ? clock->last_id : ++clock->last_id;
    call->func = func;
    call->data = data;
    GSequenceIter *iter = g_sequence_insert_sorted(clock->calls, call, compare_calls, NULL);
    g_hash_table_insert(clock->by_id, GUINT_TO_POINTER(call->id), iter);
    set_alarm(clock);
    return call->id;
}

guint clock_call_in(Clock *clock, gint64 delay_us, ClockFunc func, gpointer data) {
    g_return_val_if_fail(clock, 0);
    gint64 now = clock_now_us(clock), delay = MAX(delay_us, 0);
    return clock_call_at(clock, delay > G_MAXINT64 - now ? G_MAXINT64 : now + delay, func, data);
}

void clock_cancel(Clock *clock, guint *id) {
    if (*id == 0)
        return;
    GSequenceIter *iter = g_hash_table_lookup(clock->by_id, GUINT_TO_POINTER(*id));
    guint cancelled = *id;
    *id = 0;
    g_return_if_fail(iter != NULL);
    g_hash_table_remove(clock->by_id, GUINT_TO_POINTER(cancelled));
    g_sequence_remove(iter);
    set_alarm(clock);
}

void clock_hold(Clock *clock) {
    g_atomic_int_inc(&clock->holds);
}

void clock_release(Clock *clock) {
    gint before = g_atomic_int_add(&clock->holds, -1);
    g_return_if_fail(before > 0);
    if (before == 1)
        g_main_context_wakeup(NULL);
}

void clock_set_lockstep(Clock *clock) {
    clock->is_lockstep = TRUE;
}

gboolean clock_is_lockstep(const Clock *clock) {
    return clock->is_lockstep;
}
