#include "conformance_private.h"
#include "lib/ok.h"
#include "reports.h"

/* The suites for lamps, lasers and interlocks. */

struct bench {
    gconstpointer driver;
    const struct conformance *with;
    Clock *clock;
    LampBank *bank;
    Laser *laser;
    Interlock *door;
    gboolean failing; /* the next event has an error */
    struct conformance_safety safety;
    gboolean overtaken; /* “on” of lamp 0 may be overtaken by “off”, and then fails as busy */
    int n_events;
    int index[64];
    gboolean on[64];
    gint64 at_us;
    const int *n_reports; /* of the interlock */
};

static void note(struct bench *bench, int index, gboolean on, const GError *error) {
    if (bench->failing)
        g_assert_nonnull(error);
    else if (bench->overtaken && index == 0 && on && error)
        g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
    else
        g_assert_no_error(error);
    g_assert_cmpint(bench->n_events, <, (int)G_N_ELEMENTS(bench->index));
    bench->index[bench->n_events] = index;
    bench->on[bench->n_events++] = on;
}

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    struct bench *bench = data;
    note(bench, index, on, error);
    bench->at_us = at_us;
}

static void on_laser(Laser *laser, gboolean on, const GError *error, gpointer data) {
    note(data, 0, on, error);
}

static void end(struct bench *bench) {
    lamps_close(g_steal_pointer(&bench->bank));
    laser_close(g_steal_pointer(&bench->laser));
    interlock_close(g_steal_pointer(&bench->door));
    g_clear_pointer(&bench->clock, clock_unref);
}

static void expect_silence(struct bench *bench, double seconds) {
    bench->n_events = 0;
    conformance_pass(bench->clock, seconds);
    g_assert_cmpint(bench->n_events, ==, 0);
}

static gboolean open_bank(struct bench *bench, const char *keys) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(bench->with, keys, &section);
    g_autoptr(GError) error = NULL;
    bench->bank = lamps_open(bench->driver, section, NULL, bench->clock, &error);
    if (!conformance_opened(bench->bank, error))
        return FALSE;
    lamps_listen(bench->bank, on_lamp, bench);
    device_watch_safety(&bench->bank->device, conformance_on_safety, &bench->safety);
    return TRUE;
}

static gboolean begin_lamps(struct bench *bench, gconstpointer driver,
                            const struct conformance *with) {
    *bench = (struct bench){reports_of_lamps(driver), with, conformance_clock(with)};
    return open_bank(bench, "");
}

static void set_lamp(struct bench *bench, int index, gboolean on) {
    GError *error = NULL;
    if (index < 0)
        lamps_all_off(bench->bank, &error);
    else
        lamps_set(bench->bank, index, on, &error);
    g_assert_no_error(error);
}

static void lamps_wrong_option(struct bench *bench) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(bench->with, "no_such_option = 1\n", &section);
    GError *error = NULL;
    g_assert_null(lamps_open(bench->driver, section, NULL, bench->clock, &error));
    conformance_assert_unknown_option(error);
}

static void lamps_one_by_one(struct bench *bench) {
    g_assert_cmpint(bench->bank->n, >, 0);
    for (int i = 0; i < bench->bank->n; i++) {
        g_assert_false(lamps_is_on(bench->bank, i));
        gint64 asked = clock_now_us(bench->clock);
        for (int on = 1; on >= 0; on--) {
            bench->n_events = 0;
            set_lamp(bench, i, on);
            conformance_wait(bench->clock, &bench->n_events, 1, 10);
            g_assert_cmpint(bench->index[0], ==, i);
            g_assert_cmpint(bench->on[0], ==, on);
            g_assert_cmpint(bench->at_us, >=, asked);
            g_assert_cmpint(lamps_is_on(bench->bank, i), ==, on);
            expect_silence(bench, 0.1);
        }
    }
}

/* Checks the order of commands. “Off” may overtake commands that were not sent yet. “On” of the
 * same lamp is then not carried out. */
static void lamps_in_order(struct bench *bench) {
    int n = MIN(bench->bank->n, 16), n_first = 0;
    bench->overtaken = TRUE;
    for (int i = 0; i < n; i++)
        set_lamp(bench, i, TRUE);
    set_lamp(bench, 0, FALSE);
    conformance_wait(bench->clock, &bench->n_events, n + 1, 60);
    bench->overtaken = FALSE;
    for (int i = 0, last = 0; i <= n; i++) {
        if (bench->index[i] == 0) {
            g_assert_cmpint(bench->on[i], ==, n_first++ == 0);
            continue;
        }
        g_assert_cmpint(bench->index[i], >, last);
        last = bench->index[i];
        g_assert_true(bench->on[i]);
    }
    g_assert_cmpint(n_first, ==, 2);
    g_assert_false(lamps_is_on(bench->bank, 0));
    for (int i = 1; i < n; i++)
        g_assert_true(lamps_is_on(bench->bank, i));
    bench->n_events = 0;
    set_lamp(bench, -1, FALSE);
    conformance_wait(bench->clock, &bench->n_events, 1, 10);
    g_assert_cmpint(bench->index[0], ==, -1);
    for (int i = 0; i < bench->bank->n; i++)
        g_assert_false(lamps_is_on(bench->bank, i));
}

static void lamps_no_such_lamp(struct bench *bench) {
    int wrong[] = {-1, bench->bank->n, G_MAXINT, G_MININT};
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        GError *error = NULL;
        g_assert_false(lamps_set(bench->bank, wrong[i], TRUE, &error));
        g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_RANGE);
        g_clear_error(&error);
    }
    expect_silence(bench, 0.2);
}

/* Checks a command that is not answered: the lamp is unsafe until “off” was confirmed, and only the
 * failure of the command itself is reported. on and index are those of the command; index −1 means
 * all lamps off. */
static void lamps_unanswered(struct bench *bench, int index, gboolean on) {
    const struct device *device;
    g_autofree char *keys = conformance_fault_keys(bench->with, on ? 1 : 2);
    g_clear_pointer(&bench->bank, lamps_close);
    open_bank(bench, keys);
    device = &bench->bank->device;
    if (!on) {
        set_lamp(bench, 0, TRUE);
        conformance_wait(bench->clock, &bench->n_events, 1, 10);
        bench->n_events = 0;
    }
    conformance_fail(bench->with, CONFORMANCE_UNANSWERED);
    bench->failing = TRUE;
    set_lamp(bench, index, on);
    g_assert_cmpint(lamps_light(bench->bank, 0), ==, LIGHT_ON);
    g_assert_cmpint(lamps_safety(bench->bank), ==, DEVICE_TOLD);
    conformance_wait(bench->clock, &bench->n_events, 1, 10);
    g_assert_cmpint(lamps_light(bench->bank, 0), ==, LIGHT_UNSAFE);
    conformance_expect_unsafe(bench->with, device, &bench->safety);
    g_assert_cmpint(lamps_light(bench->bank, 0), ==, LIGHT_UNSAFE);
    g_assert_cmpint(lamps_safety(bench->bank), ==, DEVICE_UNSAFE);
    g_assert_true(lamps_is_on(bench->bank, 0));
    conformance_expect_safe(bench->with, device, &bench->safety);
    g_assert_cmpint(lamps_light(bench->bank, 0), ==, LIGHT_OFF);
    g_assert_cmpint(lamps_safety(bench->bank), ==, DEVICE_SAFE);
    g_assert_cmpint(bench->n_events, ==, 1);
    bench->failing = FALSE;
    for (int again = 1; again >= 0; again--) {
        bench->n_events = 0;
        set_lamp(bench, 0, again);
        conformance_wait(bench->clock, &bench->n_events, 1, 10);
    }
    expect_silence(bench, 0.5);
    g_assert_cmpint(bench->safety.n_unsafe, ==, 1);
}

static void lamps_on_unanswered(struct bench *bench) {
    lamps_unanswered(bench, 0, TRUE);
}

static void lamps_off_unanswered(struct bench *bench) {
    lamps_unanswered(bench, 0, FALSE);
}

static void lamps_all_off_unanswered(struct bench *bench) {
    lamps_unanswered(bench, -1, FALSE);
}

static void lamps_lost_cut(struct bench *bench) {
    set_lamp(bench, 0, TRUE);
    conformance_wait(bench->clock, &bench->n_events, 1, 10);
    bench->n_events = 0;
    conformance_fail(bench->with, CONFORMANCE_CUT);
    bench->failing = TRUE;
    lamps_lost(bench->bank,
               device_error_new(DEVICE_ERROR_PROTOCOL, bench->bank->device.who, "lost"));
    g_assert_cmpint(bench->n_events, ==, 1);
    bench->failing = !!bench->with->fail;
    conformance_wait(bench->clock, &bench->n_events, 2,
                     10); /* the class lamps has switched the lamp off */
    if (bench->with->fail)
        conformance_expect_unsafe(bench->with, &bench->bank->device, &bench->safety);
    conformance_expect_safe(bench->with, &bench->bank->device, &bench->safety);
    g_assert_cmpint(lamps_light(bench->bank, 0), ==, LIGHT_OFF);
    g_assert_cmpint(bench->n_events, ==, 2);
}

static void lamps_permit(struct bench *bench) {
    GError *error = NULL;
    device_set_permit(&bench->bank->device, conformance_refuse, NULL);
    g_assert_false(lamps_set(bench->bank, 0, TRUE, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED, "not now");
    g_assert_cmpint(lamps_light(bench->bank, 0), ==, LIGHT_OFF);
    expect_silence(bench, 0.2);
    set_lamp(bench, 0, FALSE);
    set_lamp(bench, -1, FALSE);
    conformance_wait(bench->clock, &bench->n_events, 2, 10);
    g_assert_cmpint(bench->safety.n_unsafe, ==, 0);
}

static void lamps_close_switching(struct bench *bench) {
    set_lamp(bench, 0, TRUE);
    g_clear_pointer(&bench->bank, lamps_close);
    expect_silence(bench, 1);
}

void conformance_lamps(const struct lamps_driver *driver, const struct conformance *with) {
    static const struct check checks[] = {
        {"wrong-option", lamps_wrong_option, .unopened = TRUE},
        {"one-by-one", lamps_one_by_one},
        {"in-order", lamps_in_order},
        {"no-such-lamp", lamps_no_such_lamp},
        {"close-switching", lamps_close_switching},
        {"permit", lamps_permit},
        {"on-unanswered", lamps_on_unanswered, FALSE, TRUE},
        {"off-unanswered", lamps_off_unanswered, FALSE, TRUE},
        {"all-off-unanswered", lamps_all_off_unanswered, FALSE, TRUE},
        {"lost-cut", lamps_lost_cut, FALSE, TRUE},
        {"open-close", NULL, TRUE},
        {NULL},
    };
    static const struct suite suite = {"lamps", sizeof(struct bench), begin_lamps, end, checks};
    conformance_add(&suite, driver, with);
}

/* A door that the test opens and shuts. */
static gboolean open_door(Interlock *interlock, GError **error) {
    interlock_report(interlock, TRUE);
    return TRUE;
}

static void close_door(Interlock *interlock) {
}

static const struct interlock_driver door_driver = {
    .info = {"interlock", "door", "A door that the test opens"},
    .open = open_door,
    .close = close_door,
};

static gboolean open_laser(struct bench *bench, const char *keys) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(bench->with, keys, &section);
    g_autoptr(GError) error = NULL;
    bench->laser = laser_open(bench->driver, section, NULL, bench->clock, &error);
    if (!conformance_opened(bench->laser, error))
        return FALSE;
    laser_listen(bench->laser, on_laser, bench);
    laser_guard(bench->laser, bench->door);
    device_watch_safety(&bench->laser->device, conformance_on_safety, &bench->safety);
    return TRUE;
}

static gboolean begin_laser(struct bench *bench, gconstpointer driver,
                            const struct conformance *with) {
    static const struct conformance door = {.section = "[interlock door]"};
    const struct config_section *door_section;
    g_autoptr(Config) door_config = conformance_config(&door, "", &door_section);
    *bench = (struct bench){reports_of_laser(driver), with, conformance_clock(with)};
    bench->door = ok(interlock_open(&door_driver, door_section, NULL, bench->clock, ERR));
    return open_laser(bench, "");
}

static void switch_laser(struct bench *bench, gboolean on) {
    GError *error = NULL;
    bench->n_events = 0;
    laser_set(bench->laser, on, &error);
    g_assert_no_error(error);
    conformance_wait(bench->clock, &bench->n_events, 1, 10);
    g_assert_cmpint(bench->on[0], ==, on);
    g_assert_cmpint(laser_is_on(bench->laser), ==, on);
}

static void laser_wrong_option(struct bench *bench) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(bench->with, "no_such_option = 1\n", &section);
    GError *error = NULL;
    g_assert_null(laser_open(bench->driver, section, NULL, bench->clock, &error));
    conformance_assert_unknown_option(error);
}

static void laser_switches(struct bench *bench) {
    g_assert_false(laser_is_on(bench->laser));
    switch_laser(bench, TRUE);
    expect_silence(bench, 0.2);
    switch_laser(bench, FALSE);
    switch_laser(bench, FALSE);
    expect_silence(bench, 0.2);
}

static void laser_guarded(struct bench *bench) {
    GError *error = NULL;
    switch_laser(bench, TRUE);
    bench->n_events = 0;
    interlock_report(bench->door, FALSE);
    conformance_wait(bench->clock, &bench->n_events, 1, 10);
    g_assert_false(bench->on[0]);
    g_assert_false(laser_is_on(bench->laser));
    g_assert_false(laser_set(bench->laser, TRUE, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_INTERLOCK);
    g_clear_error(&error);
    switch_laser(bench, FALSE);
    interlock_report(bench->door, TRUE);
    expect_silence(bench, 0.5);
    g_assert_false(laser_is_on(bench->laser));
    switch_laser(bench, TRUE);
}

/* The door opens between the command and its answer. */
static void laser_guarded_late(struct bench *bench) {
    bench->overtaken = TRUE;
    g_assert_true(laser_set(bench->laser, TRUE, NULL));
    interlock_report(bench->door, FALSE);
    conformance_wait(bench->clock, &bench->n_events, 2, 10);
    g_assert_false(bench->on[1]);
    g_assert_false(laser_is_on(bench->laser));
}

static void laser_unanswered(struct bench *bench, gboolean on) {
    g_autofree char *keys = conformance_fault_keys(bench->with, on ? 1 : 2);
    g_clear_pointer(&bench->laser, laser_close);
    open_laser(bench, keys);
    if (!on)
        switch_laser(bench, TRUE);
    bench->n_events = 0;
    conformance_fail(bench->with, CONFORMANCE_UNANSWERED);
    bench->failing = TRUE;
    g_assert_true(laser_set(bench->laser, on, NULL));
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_ON);
    conformance_wait(bench->clock, &bench->n_events, 1, 10);
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_UNSAFE);
    conformance_expect_unsafe(bench->with, &bench->laser->device, &bench->safety);
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_UNSAFE);
    g_assert_cmpint(laser_safety(bench->laser), ==, DEVICE_UNSAFE);
    g_assert_true(laser_is_on(bench->laser));
    conformance_expect_safe(bench->with, &bench->laser->device, &bench->safety);
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_OFF);
    g_assert_cmpint(laser_safety(bench->laser), ==, DEVICE_SAFE);
    g_assert_cmpint(bench->n_events, ==, 1);
    bench->failing = FALSE;
    switch_laser(bench, TRUE);
    switch_laser(bench, FALSE);
    expect_silence(bench, 0.5);
    g_assert_cmpint(bench->safety.n_unsafe, ==, 1);
}

static void laser_on_unanswered(struct bench *bench) {
    laser_unanswered(bench, TRUE);
}

static void laser_off_unanswered(struct bench *bench) {
    laser_unanswered(bench, FALSE);
}

static void laser_permit(struct bench *bench) {
    GError *error = NULL;
    device_set_permit(&bench->laser->device, conformance_refuse, NULL);
    g_assert_false(laser_set(bench->laser, TRUE, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED, "not now");
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_OFF);
    expect_silence(bench, 0.2);
    switch_laser(bench, FALSE);
    g_assert_cmpint(bench->safety.n_unsafe, ==, 0);
}

static void laser_close_on(struct bench *bench) {
    switch_laser(bench, TRUE);
    g_clear_pointer(&bench->laser, laser_close);
    interlock_report(bench->door, FALSE);
    expect_silence(bench, 0.5);
}

void conformance_laser(const struct laser_driver *driver, const struct conformance *with) {
    static const struct check checks[] = {
        {"wrong-option", laser_wrong_option, .unopened = TRUE},
        {"switches", laser_switches},
        {"guarded", laser_guarded},
        {"guarded-late", laser_guarded_late},
        {"close-on", laser_close_on},
        {"permit", laser_permit},
        {"on-unanswered", laser_on_unanswered, FALSE, TRUE},
        {"off-unanswered", laser_off_unanswered, FALSE, TRUE},
        {"open-close", NULL, TRUE},
        {NULL},
    };
    static const struct suite suite = {"laser", sizeof(struct bench), begin_laser, end, checks};
    conformance_add(&suite, driver, with);
}

static gboolean begin_interlock(struct bench *bench, gconstpointer driver,
                                const struct conformance *with) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(with, "", &section);
    *bench = (struct bench){.with = with, .clock = conformance_clock(with)};
    bench->driver = reports_of_interlock(driver, &bench->n_reports);
    g_autoptr(GError) error = NULL;
    bench->door = interlock_open(bench->driver, section, NULL, bench->clock, &error);
    return conformance_opened(bench->door, error);
}

static void interlock_wrong_option(struct bench *bench) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(bench->with, "no_such_option = 1\n", &section);
    GError *error = NULL;
    g_assert_null(interlock_open(bench->driver, section, NULL, bench->clock, &error));
    conformance_assert_unknown_option(error);
}

static void count(Interlock *interlock, gboolean closed, gpointer data) {
    g_assert_cmpint(closed, ==, interlock_is_closed(interlock));
    ++*(int *)data;
}

static void interlock_first_state(struct bench *bench) {
    conformance_wait(bench->clock, bench->n_reports, 1, 10);
}

/* Reports states as the driver would. Listeners are called only when the state changes. */
static void interlock_listeners(struct bench *bench) {
    int first = 0, second = 0;
    conformance_pass(bench->clock, 0.2);
    guint id = interlock_listen(bench->door, count, &first);
    interlock_listen(bench->door, count, &second);
    gboolean closed = interlock_is_closed(bench->door);
    interlock_report(bench->door, closed);
    g_assert_cmpint(first + second, ==, 0);
    interlock_report(bench->door, !closed);
    g_assert_cmpint(first, ==, 1);
    g_assert_cmpint(second, ==, 1);
    interlock_unlisten(bench->door, id);
    interlock_report(bench->door, closed);
    g_assert_cmpint(first, ==, 1);
    g_assert_cmpint(second, ==, 2);
}

/* Checks that no event comes after the interlock was closed. */
static void interlock_closed(struct bench *bench) {
    interlock_close(g_steal_pointer(&bench->door));
    conformance_pass(bench->clock, 1);
}

void conformance_interlock(const struct interlock_driver *driver, const struct conformance *with) {
    static const struct check checks[] = {
        {"wrong-option", interlock_wrong_option, .unopened = TRUE},
        {"first-state", interlock_first_state},
        {"listeners", interlock_listeners},
        {"open-close", interlock_closed, TRUE},
        {NULL},
    };
    static const struct suite suite = {"interlock", sizeof(struct bench), begin_interlock, end,
                                       checks};
    conformance_add(&suite, driver, with);
}
