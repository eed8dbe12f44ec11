#include "conformance_private.h"
#include "lib/ok.h"
#include "lib/wait.h"

struct test {
    const struct suite *suite;
    gconstpointer driver;
    const struct conformance *with;
    const struct check *check;
    gboolean no_fault; /* the check needs a fault, and the device cannot be made to fail */
};

static void run(gconstpointer data) {
    const struct test *test = data;
    if (test->no_fault) {
        g_test_skip("give fail(): lost answers are not tested");
        return;
    }
    g_autofree struct bench *bench = g_malloc0(test->suite->bench_size);
    const gboolean opened = test->suite->begin(bench, test->driver, test->with);
    if (!opened && !test->check->unopened)
        g_test_skip("open() is not implemented");
    else if (test->check->run)
        test->check->run(bench);
    test->suite->end(bench);
    if (!opened)
        return;
    int files = conformance_open_files();
    for (int i = 0; test->check->reopens && i < 20; i++) {
        test->suite->begin(bench, test->driver, test->with);
        test->suite->end(bench);
    }
    if (test->check->reopens)
        conformance_expect_files(test->with, files, WAIT_S);
}

gboolean conformance_opened(gconstpointer device, const GError *error) {
    if (!device && g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED) &&
        strstr(error->message, "open() is not implemented"))
        return FALSE;
    g_assert_no_error(error);
    g_assert_nonnull(device);
    return TRUE;
}

void conformance_add(const struct suite *suite, gconstpointer driver,
                     const struct conformance *with) {
    const struct driver_info *info = driver;
    const gboolean fails = with->fail || g_str_has_prefix(info->name, "sim-");
    for (const struct check *check = suite->checks; check->name; check++) {
        g_autofree char *path =
            g_strdup_printf("/conformance/%s/%s/%s", suite->class_name, with->name, check->name);
        struct test *test = g_new0(struct test, 1);
        *test = (struct test){suite, driver, with, check, check->needs_fault && !fails};
        g_test_add_data_func_full(path, test, (GTestDataFunc)run, g_free);
    }
}

void conformance_assert_unknown_option(GError *error) {
    g_assert_error(error, CONFIG_ERROR, CONFIG_ERROR_UNKNOWN);
    g_assert_nonnull(strstr(error->message, "no_such_option"));
    g_error_free(error);
}

void conformance_on_safety(struct device *device, const GError *error, gpointer data) {
    struct conformance_safety *safety = data;
    g_assert_cmpint(device_is_unsafe(device), ==, error != NULL);
    *(error ? &safety->n_unsafe : &safety->n_safe) += 1;
}

char *conformance_fault_keys(const struct conformance *with, int n) {
    return with->fail ? g_strdup("") : g_strdup_printf("fault_unheard = %d\nfault_dead_s = 5\n", n);
}

void conformance_fail(const struct conformance *with, enum conformance_fault fault) {
    if (with->fail)
        with->fail(with->fail_data, fault);
}

void conformance_expect_unsafe(const struct conformance *with, const struct device *device,
                               const struct conformance_safety *safety) {
    conformance_fail(with, CONFORMANCE_CUT);
    conformance_pass(device->clock, 1);
    g_assert_true(device_is_unsafe(device));
    g_assert_cmpint(safety->n_unsafe, ==, 1);
    g_assert_cmpint(safety->n_safe, ==, 0);
}

void conformance_expect_safe(const struct conformance *with, const struct device *device,
                             const struct conformance_safety *safety) {
    conformance_fail(with, CONFORMANCE_WELL);
    conformance_wait(device->clock, &safety->n_safe, 1, 30);
    g_assert_false(device_is_unsafe(device));
    g_assert_cmpint(safety->n_unsafe, ==, 1);
    g_assert_cmpint(safety->n_safe, ==, 1);
}

gboolean conformance_refuse(const struct device *device, gpointer unused, GError **error) {
    return device_error_set(error, DEVICE_ERROR_UNSUPPORTED, device->who, "not now");
}

Clock *conformance_clock(const struct conformance *with) {
    return with->real_clock ? clock_new_real() : clock_new_virtual();
}

Config *conformance_config(const struct conformance *with, const char *more_keys,
                           const struct config_section **ret_section) {
    g_autofree char *text = g_strconcat(with->section, "\n", more_keys, NULL);
    Config *config = ok(config_parse(text, with->path ? with->path : "./test.conf", ERR));
    gsize n;
    *ret_section = config_sections(config, &n);
    g_assert_cmpuint(n, ==, 1);
    return config;
}

static void set_flag(gpointer data) {
    *(gboolean *)data = TRUE;
}

void conformance_wait(Clock *clock, const int *counter, int n, double limit_s) {
    const double s = clock_is_virtual(clock) ? limit_s : WAIT_S;
    gboolean over = FALSE;
    guint limit = clock_call_in(clock, (gint64)(s * 1e6), set_flag, &over);
    while (*counter < n && !over)
        g_main_context_iteration(NULL, TRUE);
    if (over)
        g_error("waited %g s for an event that did not come", s);
    clock_cancel(clock, &limit);
}

void conformance_pass(Clock *clock, double seconds) {
    gboolean over = FALSE;
    clock_call_in(clock, (gint64)(seconds * 1e6), set_flag, &over);
    while (!over)
        g_main_context_iteration(NULL, TRUE);
}

void conformance_expect_error(GError **error, GQuark domain, int code, const char *words) {
    g_assert_error(*error, domain, code);
    if (!strstr((*error)->message, words))
        g_error("\"%s\" does not say \"%s\"", (*error)->message, words);
    g_clear_error(error);
}

int conformance_open_files(void) {
    g_autoptr(GDir) dir = g_dir_open("/proc/self/fd", 0, NULL);
    int n = 0;
    while (dir && g_dir_read_name(dir))
        n++;
    return n;
}

void conformance_expect_files(const struct conformance *with, int files, int limit_s) {
    g_autoptr(Clock) clock = conformance_clock(with);
    UNTIL_WITHIN (limit_s, conformance_open_files() <= files) {
        conformance_pass(clock, 0.05);
        g_usleep(1000);
    }
}
