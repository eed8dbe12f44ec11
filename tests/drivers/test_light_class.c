/* The classes of lights and of their guards: lamps, lasers and interlocks. */
#include "lib/heard.h"
#include "lib/ok.h"

#include <math.h>
#include <string.h>

static void on_lamp(LampBank *from, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    heard_event(data, index, error);
}

static void on_laser(Laser *from, gboolean on, const GError *error, gpointer data) {
    heard_event(data, on, error);
}

static LampBank *open_lamps(const struct lamps_driver *driver, const char *keys,
                            struct heard *heard) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&bank, keys, &section);
    const char *const also[] = {"world", NULL};
    LampBank *opened = ok(lamps_open(driver, section, also, heard->clock, ERR));
    lamps_listen(opened, on_lamp, heard);
    return opened;
}

static double lamp_output(Clock *clock, int lamp) {
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct world_state state;
    world_snapshot(world, clock_now_us(clock), 1000, &state);
    return state.lamp_output[lamp];
}

static void switch_lamp(LampBank *to, struct heard *heard, int index, gboolean on) {
    g_assert_true(lamps_set(to, index, on, NULL));
    heard_next(heard, index);
    if (on)
        conformance_pass(heard->clock, to->warm_up_s);
}

static void test_dead_lamp(struct heard *heard, gconstpointer unused) {
    g_autoptr(World) world = world_get(WORLD, NULL);
    g_autoptr(LampBank) lit =
        open_lamps(&sim_lamps_driver,
                   "lamps = lamp60; lamp30\nfault_dead = lamp30\nfault_dead_after = 2\n", heard);
    int lamp60 = world_find_lamp(world, "lamp60"), lamp30 = world_find_lamp(world, "lamp30");
    for (int i = 0; i < 4; i++) {
        switch_lamp(lit, heard, 0, TRUE);
        g_assert_cmpfloat(lamp_output(heard->clock, lamp60), >, 0.9);
        g_assert_cmpfloat(lamp_output(heard->clock, lamp30), ==, 0);
        switch_lamp(lit, heard, 0, FALSE);
        switch_lamp(lit, heard, 1, TRUE);
        g_assert_cmpint(lamp_output(heard->clock, lamp30) > 0.9, ==, i < 2);
        g_assert_true(lamps_is_on(lit, 1)); /* its switch answers all the same */
        switch_lamp(lit, heard, 1, FALSE);
    }
    switch_lamp(lit, heard, 0, TRUE);
    g_clear_pointer(&lit, lamps_close);
    conformance_pass(heard->clock, 0.1);
    g_assert_cmpfloat(lamp_output(heard->clock, lamp60), ==, 0);
}

/* A bank and a laser that record their commands; the test answers. */
#define N_SCRIPTED 3
#define MAX_SENT   64

struct script {
    int n; /* commands so far */
    struct {
        int index;
        gboolean on;
        gint64 at_us;
    } sent[MAX_SENT];
    gboolean refuses;     /* with an error from set() */
    int n_unsafe, n_safe; /* what the watch has heard */
    char *why;
};

static struct script script;

static gboolean scripted_set(Clock *clock, int index, gboolean on, GError **error) {
    g_assert_cmpint(script.n, <, MAX_SENT);
    script.sent[script.n].index = index;
    script.sent[script.n].on = on;
    script.sent[script.n++].at_us = clock_now_us(clock);
    return !script.refuses || device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL, "is gone");
}

static gboolean scripted_lamps_open(LampBank *from, GError **error) {
    from->n = N_SCRIPTED;
    return TRUE;
}

static void scripted_lamps_close(LampBank *from) {
}

static gboolean scripted_lamps_set(LampBank *from, int index, gboolean on, GError **error) {
    return scripted_set(from->device.clock, index, on, error);
}

static const struct lamps_driver scripted_lamps_driver = {
    .info = {"lamps", "scripted", "Says what the test says"},
    .open = scripted_lamps_open,
    .close = scripted_lamps_close,
    .set = scripted_lamps_set,
};

static gboolean scripted_laser_open(Laser *from, GError **error) {
    return TRUE;
}

static void scripted_laser_close(Laser *from) {
}

static gboolean scripted_laser_set(Laser *from, gboolean on, GError **error) {
    return scripted_set(from->device.clock, 0, on, error);
}

static const struct laser_driver scripted_laser_driver = {
    .info = {"laser", "scripted", "Says what the test says"},
    .open = scripted_laser_open,
    .close = scripted_laser_close,
    .set = scripted_laser_set,
};

static void on_safety(struct device *device, const GError *error, gpointer data) {
    *(error ? &script.n_unsafe : &script.n_safe) += 1;
    g_free(script.why);
    script.why = g_strdup(error ? error->message : "");
}

static LampBank *open_scripted(struct heard *heard) {
    LampBank *opened = open_lamps(&scripted_lamps_driver, "", heard);
    g_free(script.why);
    script = (struct script){0};
    device_watch_safety(&opened->device, on_safety, NULL);
    return opened;
}

static Laser *open_scripted_laser(struct heard *heard) {
    const struct config_section *section;
    static const struct conformance with = {.section = "[laser l]"};
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    Laser *opened = ok(laser_open(&scripted_laser_driver, section, NULL, heard->clock, ERR));
    laser_listen(opened, on_laser, heard);
    g_free(script.why);
    script = (struct script){0};
    device_watch_safety(&opened->device, on_safety, NULL);
    return opened;
}

static void expect_sent(int n, int index, gboolean on) {
    g_assert_cmpint(script.n, ==, n);
    g_assert_cmpint(script.sent[n - 1].index, ==, index);
    g_assert_cmpint(script.sent[n - 1].on, ==, on);
}

static GError *no_answer(void) {
    return device_error_new(DEVICE_ERROR_TIMEOUT, NULL, "no answer");
}

/* "On" is not answered: "off" is sent until it is confirmed, and only the first failure is
 * reported. */
static void test_lamp_deadline(struct heard *heard, gconstpointer unused) {
    g_autoptr(LampBank) silent = open_scripted(heard);
    gint64 start = clock_now_us(heard->clock);
    g_assert_cmpint(lamps_light(silent, 1), ==, LIGHT_OFF);
    g_assert_true(lamps_set(silent, 1, TRUE, NULL));
    g_assert_cmpint(lamps_light(silent, 1), ==, LIGHT_ON);
    g_assert_cmpint(lamps_safety(silent), ==, DEVICE_TOLD);
    heard_next(heard, 1);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    g_assert_cmpint(heard->at_us - start, ==, 2000000);
    g_assert_cmpint(lamps_light(silent, 1), ==, LIGHT_UNSAFE);
    g_assert_true(lamps_is_on(silent, 1));
    g_assert_cmpint(lamps_safety(silent), ==, DEVICE_UNSAFE);
    g_assert_cmpint(lamps_light(silent, 0), ==, LIGHT_OFF);
    g_assert_true(device_is_unsafe(&silent->device));
    conformance_pass(heard->clock, 0.01);
    expect_sent(2, -1, FALSE);
    g_assert_cmpint(script.n_unsafe, ==, 1);
    g_assert_nonnull(strstr(script.why, "lamp 1 did not answer to \"on\" within 2 s"));
    lamps_report(silent, 1, TRUE, NULL); /* too late, but it is lit */
    g_assert_cmpint(lamps_light(silent, 1), ==, LIGHT_UNSAFE);
    conformance_pass(heard->clock, 20);
    g_assert_cmpint(script.n, >, 8);
    g_assert_cmpint(lamps_light(silent, 1), ==, LIGHT_UNSAFE);
    lamps_report(silent, -1, FALSE, NULL);
    g_assert_cmpint(lamps_light(silent, 1), ==, LIGHT_OFF);
    g_assert_cmpint(lamps_safety(silent), ==, DEVICE_SAFE);
    conformance_pass(heard->clock, 20); /* a light that is off gets no command */
    g_assert_cmpint(script.n_unsafe, ==, 1);
    g_assert_cmpint(script.n_safe, ==, 1);
    g_assert_cmpint(heard->n, ==, 0);
    const int n = script.n;
    conformance_pass(heard->clock, 20);
    g_assert_cmpint(script.n, ==, n);
}

/* An "off" that fails is repeated with pauses that grow. */
static void test_off_fails(struct heard *heard, gconstpointer unused) {
    static const int pauses_ms[] = {100, 200, 300, 300, 300};
    g_autoptr(LampBank) opened = open_scripted(heard);
    g_assert_true(lamps_set(opened, 2, TRUE, NULL));
    lamps_report(opened, 2, TRUE, NULL);
    heard_next(heard, 2);
    g_assert_true(lamps_set(opened, 2, FALSE, NULL));
    g_assert_cmpint(lamps_light(opened, 2), ==, LIGHT_ON); /* on its way for the first time */
    lamps_report(opened, 2, FALSE, no_answer());
    heard_next(heard, 2);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    for (gsize i = 0; i < G_N_ELEMENTS(pauses_ms); i++) {
        const gint64 failed = clock_now_us(heard->clock);
        g_assert_cmpint(lamps_light(opened, 2), ==, LIGHT_UNSAFE);
        while (script.n < 3 + (int)i)
            g_main_context_iteration(NULL, TRUE);
        expect_sent(3 + (int)i, -1, FALSE);
        g_assert_cmpint(script.sent[2 + i].at_us - failed, ==, pauses_ms[i] * 1000);
        lamps_report(opened, -1, FALSE, no_answer());
    }
    conformance_pass(heard->clock, 0.31);
    lamps_report(opened, -1, FALSE, NULL);
    conformance_pass(heard->clock, 1);
    g_assert_cmpint(lamps_light(opened, 2), ==, LIGHT_OFF);
    g_assert_cmpint(heard->n, ==, 0);
    g_assert_cmpint(script.n_unsafe, ==, 1);
    g_assert_cmpint(script.n_safe, ==, 1);
}

/* The answer to an "off" that was sent before an "on" proves nothing. */
static void test_answers_in_order(struct heard *heard, gconstpointer unused) {
    g_autoptr(Laser) opened = open_scripted_laser(heard);
    g_assert_true(laser_set(opened, FALSE, NULL));
    heard_next(heard, FALSE);            /* not answered */
    conformance_pass(heard->clock, 0.2); /* sent again */
    g_assert_cmpint(script.n, ==, 2);
    g_assert_true(laser_set(opened, TRUE, NULL));
    heard_next(heard, TRUE);
    conformance_pass(heard->clock, 0.01);
    expect_sent(4, 0, FALSE);
    for (int i = 0; i < 2; i++) {
        laser_report(opened, FALSE, NULL);
        g_assert_cmpint(laser_light(opened), ==, i == 0 ? LIGHT_UNSAFE : LIGHT_OFF);
    }
    g_assert_cmpint(heard->n, ==, 0);
}

/* Light without a command, after "off" was confirmed. */
static void test_light_by_itself(struct heard *heard, gconstpointer unused) {
    g_autoptr(Laser) opened = open_scripted_laser(heard);
    g_assert_true(laser_set(opened, FALSE, NULL));
    laser_report(opened, FALSE, NULL);
    heard_next(heard, FALSE);
    laser_report(opened, TRUE, NULL);
    g_assert_cmpint(laser_light(opened), ==, LIGHT_UNSAFE);
    conformance_pass(heard->clock, 0.01);
    expect_sent(2, 0, FALSE);
    laser_report(opened, FALSE, NULL);
    g_assert_cmpint(laser_light(opened), ==, LIGHT_OFF);
    conformance_pass(heard->clock, 0.01);
    g_assert_cmpint(heard->n, ==, 0);
    g_assert_cmpint(script.n_unsafe, ==, 1);
    g_assert_cmpint(script.n_safe, ==, 1);
}

/* Lamps that are wanted stay on while another is put out. */
static void test_others_stay_on(struct heard *heard, gconstpointer unused) {
    g_autoptr(LampBank) opened = open_scripted(heard);
    g_assert_true(lamps_set(opened, 0, TRUE, NULL));
    lamps_report(opened, 0, TRUE, NULL);
    for (int i = 1; i < N_SCRIPTED; i++) {
        g_assert_true(lamps_set(opened, i, TRUE, NULL));
        lamps_report(opened, i, TRUE, no_answer());
    }
    for (int i = 0; i < 4; i++) { /* the others in turn */
        conformance_pass(heard->clock, 0.31);
        expect_sent(4 + i, 1 + i % 2, FALSE);
        lamps_report(opened, 1 + i % 2, FALSE, i < 2 ? no_answer() : NULL);
        g_assert_cmpint(lamps_light(opened, 0), ==, LIGHT_ON);
        g_assert_cmpint(lamps_safety(opened), ==, DEVICE_UNSAFE);
        g_assert_cmpint(lamps_light(opened, 2), ==, i < 3 ? LIGHT_UNSAFE : LIGHT_OFF);
        if (i == 3)
            break;
    }
    conformance_pass(heard->clock, 1);
    g_assert_cmpint(script.n, ==, 7);
    g_assert_cmpint(script.n_safe, ==, 1);
}

/* Wanted again while it is put out: the answer to the last command decides. */
static void test_on_again(struct heard *heard, gconstpointer unused) {
    g_autoptr(Laser) opened = open_scripted_laser(heard);
    g_assert_true(laser_set(opened, TRUE, NULL));
    laser_report(opened, TRUE, no_answer());
    conformance_pass(heard->clock, 0.01);
    expect_sent(2, 0, FALSE);
    g_assert_true(laser_set(opened, TRUE, NULL));
    g_assert_cmpint(laser_light(opened), ==, LIGHT_ON);
    laser_report(opened, FALSE, NULL); /* the class's */
    g_assert_cmpint(laser_light(opened), ==, LIGHT_ON);
    laser_report(opened, TRUE, NULL);
    g_assert_cmpint(laser_light(opened), ==, LIGHT_ON);
    conformance_pass(heard->clock, 5);
    g_assert_cmpint(script.n, ==, 3);
    g_assert_false(device_is_unsafe(&opened->device));
    g_assert_cmpint(script.n_safe, ==, 1);
}

/* A driver that cannot even send: the same. */
static void test_refused(struct heard *heard, gconstpointer unused) {
    g_autoptr(Laser) opened = open_scripted_laser(heard);
    GError *error = NULL;
    script.refuses = TRUE;
    g_assert_false(laser_set(opened, TRUE, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    g_clear_error(&error);
    g_assert_cmpint(laser_light(opened), ==, LIGHT_UNSAFE);
    g_assert_cmpint(script.n_unsafe, ==, 0); /* not from within the call */
    conformance_pass(heard->clock, 3);
    g_assert_cmpint(script.n_unsafe, ==, 1);
    g_assert_cmpint(script.n, >=, 9);
    g_assert_cmpint(heard->n, ==, 0);
    script.refuses = FALSE;
    const int n = script.n;
    while (script.n == n)
        g_main_context_iteration(NULL, TRUE);
    laser_report(opened, FALSE, NULL);
    g_assert_cmpint(laser_light(opened), ==, LIGHT_OFF);
}

static void test_lost(struct heard *heard, gconstpointer unused) {
    g_autoptr(LampBank) opened = open_scripted(heard);
    g_assert_true(lamps_set(opened, 1, TRUE, NULL));
    lamps_report(opened, 1, TRUE, NULL);
    heard_next(heard, 1);
    lamps_lost(opened, device_error_new(DEVICE_ERROR_PROTOCOL, NULL, "reads as off"));
    heard_next(heard, -1);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL);
    expect_sent(2, -1, FALSE);
    for (int i = 0; i < N_SCRIPTED; i++)
        g_assert_cmpint(lamps_light(opened, i), ==, LIGHT_UNSAFE);
    lamps_report(opened, -1, FALSE, no_answer());
    heard_next(heard, -1);
    conformance_pass(heard->clock, 0.11);
    expect_sent(3, -1, FALSE);
    lamps_report(opened, -1, FALSE, NULL);
    for (int i = 0; i < N_SCRIPTED; i++)
        g_assert_cmpint(lamps_light(opened, i), ==, LIGHT_OFF);
    g_assert_cmpint(heard->n, ==, 0);
}

/* A listener that is added later is told about an unsafe device. A closed device is not used again.
 */
static void test_watch(struct heard *heard, gconstpointer unused) {
    g_autoptr(Laser) opened = open_scripted_laser(heard);
    g_assert_true(laser_set(opened, TRUE, NULL));
    laser_report(opened, TRUE, no_answer());
    conformance_pass(heard->clock, 0.01);
    g_assert_cmpint(script.n_unsafe, ==, 1);
    device_watch_safety(&opened->device, on_safety, NULL);
    conformance_pass(heard->clock, 0.01);
    g_assert_cmpint(script.n_unsafe, ==, 2);
    g_clear_pointer(&opened, laser_close);
    const int n = script.n;
    conformance_pass(heard->clock, 5);
    g_assert_cmpint(script.n, ==, n);
    g_assert_cmpint(script.n_safe, ==, 0);
}

static gboolean refuse(const struct device *device, gpointer data, GError **error) {
    ++*(int *)data;
    return device_error_set(error, DEVICE_ERROR_BUSY, device->who, "the rig is in its safe state");
}

static void test_permit(struct heard *heard, gconstpointer unused) {
    int n_asked = 0;
    GError *error = NULL;
    g_autoptr(LampBank) opened = open_scripted(heard);
    device_set_permit(&opened->device, refuse, &n_asked);
    g_assert_false(lamps_set(opened, 0, TRUE, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_BUSY, "in its safe state");
    g_assert_cmpint(n_asked, ==, 1);
    g_assert_cmpint(script.n, ==, 0);
    g_assert_cmpint(lamps_light(opened, 0), ==, LIGHT_OFF);
    g_assert_true(lamps_set(opened, 0, FALSE, NULL));
    g_assert_true(lamps_all_off(opened, NULL));
    g_assert_cmpint(n_asked, ==, 1);
    g_assert_cmpint(script.n, ==, 2);
    device_set_permit(&opened->device, NULL, NULL);
    g_assert_true(lamps_set(opened, 0, TRUE, NULL));
    g_assert_cmpint(script.n, ==, 3);
}

/* The fault that the simulated devices have for runs of the whole rig. */
static void test_sim_unheard(struct heard *heard, gconstpointer unused) {
    g_autoptr(World) world = world_get(WORLD, NULL);
    const struct config_section *section;
    g_autoptr(Config) config =
        conformance_config(&laser, "fault_unheard = 1\nfault_dead_s = 6\n", &section);
    struct world_state state;
    const int index = world_find_laser(world, "laser30");
    g_autoptr(Laser) lit = laser_open(&sim_laser_driver, section, NULL, heard->clock, NULL);
    const gint64 start = clock_now_us(heard->clock);
    laser_listen(lit, on_laser, heard);
    g_assert_true(laser_set(lit, TRUE, NULL));
    heard_next(heard, TRUE);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    while (laser_light(lit) == LIGHT_UNSAFE)
        g_main_context_iteration(NULL, TRUE);
    g_assert_cmpint(laser_light(lit), ==, LIGHT_OFF);
    g_assert_cmpint(clock_now_us(heard->clock) - start, >, 6000000);
    g_assert_cmpint(clock_now_us(heard->clock) - start, <, 7000000);
    world_snapshot(world, clock_now_us(heard->clock), 1, &state);
    g_assert_false(state.laser_on[index]);
    g_assert_cmpint(heard->n, ==, 0);
}

static void test_laser_stays_on(struct heard *heard, gconstpointer unused) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&laser, "fault_stays_on = yes\n", &section);
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct world_state state;
    int index = world_find_laser(world, "laser30");
    g_autoptr(Laser) stuck = laser_open(&sim_laser_driver, section, NULL, heard->clock, NULL);
    laser_listen(stuck, on_laser, heard);
    for (int on = 1; on >= 0; on--) {
        g_assert_true(laser_set(stuck, on, NULL));
        heard_next(heard, on);
        g_assert_cmpint(laser_is_on(stuck), ==, on);
        world_snapshot(world, clock_now_us(heard->clock), 1, &state);
        g_assert_true(state.laser_on[index]);
    }
    g_clear_pointer(&stuck, laser_close);
    world_snapshot(world, clock_now_us(heard->clock), 1, &state);
    g_assert_false(state.laser_on[index]);
}

static void test_door(void) {
    const struct config_section *section;
    g_autoptr(Config) config =
        conformance_config(&door, "open_after_s = 10\nopen_for_s = 5\n", &section);
    g_autoptr(Clock) clock = clock_new_virtual();
    g_autoptr(Interlock) opened = interlock_open(&sim_interlock_driver, section, NULL, clock, NULL);
    g_assert_true(interlock_is_closed(opened));
    conformance_pass(clock, 9.9);
    g_assert_true(interlock_is_closed(opened));
    conformance_pass(clock, 0.2);
    g_assert_false(interlock_is_closed(opened));
    conformance_pass(clock, 5);
    g_assert_true(interlock_is_closed(opened));
}

static const struct {
    const char *name;
    void (*run)(struct heard *heard, gconstpointer unused);
} tests[] = {
    {"/lamps/dead", test_dead_lamp},
    {"/lamps/deadline", test_lamp_deadline},
    {"/lamps/off-fails", test_off_fails},
    {"/lamps/others-stay-on", test_others_stay_on},
    {"/lamps/lost", test_lost},
    {"/lamps/permit", test_permit},
    {"/laser/answers-in-order", test_answers_in_order},
    {"/laser/light-by-itself", test_light_by_itself},
    {"/laser/on-again", test_on_again},
    {"/laser/refused", test_refused},
    {"/laser/watch", test_watch},
    {"/laser/sim-unheard", test_sim_unheard},
    {"/laser/stays-on", test_laser_stays_on},
};

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_autoptr(World) built_once = world_get(WORLD, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(tests); i++)
        g_test_add(tests[i].name, struct heard, NULL, heard_begin, tests[i].run, heard_end);
    g_test_add_func("/interlock/door", test_door);
    int result = g_test_run();
    g_free(script.why);
    return result;
}
