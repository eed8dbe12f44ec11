#include "drivers/clock.h"
#include "lib/test.h"

#include <stdio.h>
#include <string.h>

struct log {
    GString *text;
    Clock *clock;
};

struct call {
    struct log *log;
    const char *name;
    gint64 again_us;
};

static void say(gpointer data) {
    struct call *call = data;
    g_string_append_printf(call->log->text, "%s@%" G_GINT64_FORMAT " ", call->name,
                           clock_now_us(call->log->clock));
    if (call->again_us > 0)
        clock_call_in(call->log->clock, call->again_us, say, call);
}

static void stop(gpointer data) {
    *(gboolean *)data = TRUE;
}

static void run_until(Clock *clock, gint64 at_us) {
    gboolean over = FALSE;
    clock_call_at(clock, at_us, stop, &over);
    while (!over)
        g_main_context_iteration(NULL, TRUE);
}

TEST(order) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct log log = {g_string_new(NULL), clock};
    struct call a = {&log, "a", 0}, b = {&log, "b", 0}, c = {&log, "c", 0}, d = {&log, "d", 0};
    g_assert_true(clock_is_virtual(clock));
    g_assert_cmpuint(clock_call_at(clock, 3600000000, say, &c), !=, 0);
    clock_call_at(clock, 10, say, &a);
    clock_call_at(clock, 10, say, &b); /* the same time: in the order asked for */
    clock_call_at(clock, -5, say, &d); /* passed: as soon as possible */
    run_until(clock, 3600000001);      /* an hour, for which nobody waits */
    g_assert_cmpstr(log.text->str, ==, "d@0 a@10 b@10 c@3600000000 ");
    g_string_free(log.text, TRUE);
}

TEST(repeat_and_cancel) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct log log = {g_string_new(NULL), clock};
    struct call tick = {&log, "t", 100}, never = {&log, "never", 0};
    clock_call_in(clock, 100, say, &tick);
    guint id = clock_call_in(clock, 150, say, &never), none = 0;
    clock_cancel(clock, &id);
    g_assert_cmpuint(id, ==, 0);
    clock_cancel(clock, &id);
    clock_cancel(clock, &none);
    run_until(clock, 350);
    g_assert_cmpstr(log.text->str, ==, "t@100 t@200 t@300 ");
    g_string_free(log.text, TRUE);
}

static gboolean idle_say(gpointer data) {
    struct call *call = data;
    g_string_append_printf(call->log->text, "%s ", call->name);
    return G_SOURCE_REMOVE;
}

static void start_idle(gpointer data) {
    say(data);
    g_idle_add_full(G_PRIORITY_LOW, idle_say, data, NULL);
}

/* What a call has made ready goes before the next jump. */
TEST(behind_everything) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct log log = {g_string_new(NULL), clock};
    struct call a = {&log, "a", 0}, b = {&log, "b", 0};
    clock_call_at(clock, 10, start_idle, &a);
    clock_call_at(clock, 10, say, &b);
    run_until(clock, 20);
    g_assert_cmpstr(log.text->str, ==, "a@10 a b@10 ");
    g_string_free(log.text, TRUE);
}

static gboolean worked(gpointer data) {
    struct log *log = data;
    g_string_append_printf(log->text, "worked@%" G_GINT64_FORMAT " ", clock_now_us(log->clock));
    return G_SOURCE_REMOVE;
}

static gpointer work_thread(gpointer data) {
    struct log *log = data;
    g_usleep(50000);
    g_idle_add(worked, log);
    clock_release(log->clock);
    return NULL;
}

/* Time stands while another thread works, and goes on when it is done, without a push. */
TEST(hold) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct log log = {g_string_new(NULL), clock};
    struct call a = {&log, "a", 0};
    for (int i = 0; i < 5; i++) {
        g_string_truncate(log.text, 0);
        gint64 before = clock_now_us(clock);
        clock_call_in(clock, 1000, say, &a);
        clock_hold(clock);
        clock_hold(clock);
        clock_release(clock);
        GThread *thread = g_thread_new("work", work_thread, &log);
        run_until(clock, before + 2000);
        g_thread_join(thread);
        g_autofree char *expected = g_strdup_printf(
            "worked@%" G_GINT64_FORMAT " a@%" G_GINT64_FORMAT " ", before, before + 1000);
        g_assert_cmpstr(log.text->str, ==, expected);
    }
    g_string_free(log.text, TRUE);
}

TEST(real) {
    g_autoptr(Clock) clock = clock_new_real();
    struct log log = {g_string_new(NULL), clock};
    struct call a = {&log, "a", 0}, b = {&log, "b", 0};
    g_assert_false(clock_is_virtual(clock));
    gint64 start = clock_now_us(clock), wall = g_get_monotonic_time();
    clock_hold(clock); /* no effect */
    clock_call_in(clock, 30000, say, &b);
    clock_call_in(clock, 10000, say, &a);
    guint id = clock_call_in(clock, 5000, say, &b);
    clock_cancel(clock, &id);
    run_until(clock, start + 50000);
    clock_release(clock);
    g_assert_cmpint(clock_now_us(clock) - start, >=, 50000);
    g_assert_cmpint(g_get_monotonic_time() - wall, >=, 50000);
    gint64 a_us = 0, b_us = 0;
    g_assert_true(
        sscanf(log.text->str, "a@%" G_GINT64_FORMAT " b@%" G_GINT64_FORMAT " ", &a_us, &b_us) == 2);
    g_assert_cmpint(a_us - start, >=, 10000);
    g_assert_cmpint(b_us - start, >=, 30000);
    g_string_free(log.text, TRUE);
}

/* Pending calls are dropped with the clock. */
TEST(dropped) {
    struct log log = {g_string_new(NULL), NULL};
    struct call a = {&log, "a", 0};
    for (int real = 0; real < 2; real++) {
        Clock *clock = real ? clock_new_real() : clock_new_virtual();
        log.clock = clock;
        clock_call_in(clock, 0, say, &a);
        clock_ref(clock);
        clock_unref(clock);
        clock_unref(clock);
    }
    clock_unref(NULL);
    while (g_main_context_iteration(NULL, FALSE))
        ;
    g_assert_cmpstr(log.text->str, ==, "");
    g_string_free(log.text, TRUE);
}

/* Threads ask for it; a clock alone makes no difference. */
TEST(lockstep) {
    g_autoptr(Clock) clock = clock_new_virtual();
    g_assert_false(clock_is_lockstep(clock));
    clock_set_lockstep(clock);
    g_assert_true(clock_is_lockstep(clock));
    g_assert_true(clock_is_virtual(clock));
    struct log log = {g_string_new(NULL), clock};
    struct call a = {&log, "a", 0};
    clock_call_at(clock, 10, say, &a);
    run_until(clock, 11);
    g_assert_cmpstr(log.text->str, ==, "a@10 ");
    g_string_free(log.text, TRUE);
}

/* Random calls and cancels: each is made once, at its time, in order. */
struct random_call {
    Clock *clock;
    gint64 due_us;
    int index, *n_made;
    guint id;
    gboolean made;
};

static gint64 last_due;
static int last_index;

static void random_due(gpointer data) {
    struct random_call *call = data;
    call->id = 0;
    g_assert_false(call->made);
    g_assert_cmpint(clock_now_us(call->clock), ==, call->due_us);
    g_assert_true(call->due_us > last_due ||
                  (call->due_us == last_due && call->index > last_index));
    last_due = call->due_us;
    last_index = call->index;
    call->made = TRUE;
    ++*call->n_made;
}

TEST(random) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct random_call calls[500];
    int n_made = 0, n_cancelled = 0;
    last_due = last_index = -1;
    for (int i = 0; i < (int)G_N_ELEMENTS(calls); i++) {
        calls[i] = (struct random_call){clock, g_test_rand_int_range(0, 100), i, &n_made, 0, FALSE};
        calls[i].id = clock_call_at(clock, calls[i].due_us, random_due, &calls[i]);
        if (i % 3 == 0) {
            int other = g_test_rand_int_range(0, i + 1);
            n_cancelled += calls[other].id != 0;
            clock_cancel(clock, &calls[other].id);
        }
    }
    run_until(clock, 101);
    g_assert_cmpint(n_made, ==, (int)G_N_ELEMENTS(calls) - n_cancelled);
}
