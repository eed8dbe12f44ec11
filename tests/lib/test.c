#include "lib/test.h"

#include <string.h>

struct test {
    char *path;
    void (*run)(void);
};

static GArray *tests;
static void (*before)(void), (*after)(void);
static int (*runner)(void) = g_test_run;

/* "…/test_ball_cases.c", "glossy__small" → "/ball-cases/glossy/small" */
static char *path_of(const char *file, const char *name) {
    g_autofree char *base = g_path_get_basename(file);
    const char *from = g_str_has_prefix(base, "test_") ? base + strlen("test_") : base;
    GString *path = g_string_new("/");
    g_string_append_len(path, from, strcspn(from, "."));
    g_string_append_printf(path, "/%s", name);
    g_string_replace(path, "__", "/", 0);
    g_string_replace(path, "_", "-", 0);
    return g_string_free(path, FALSE);
}

void tests_register(const char *file, const char *name, void (*run)(void)) {
    const struct test test = {path_of(file, name), run};
    if (!tests)
        tests = g_array_new(FALSE, FALSE, sizeof test);
    g_array_append_val(tests, test);
}

void tests_set_before(void (*run)(void)) {
    before = run;
}

void tests_set_after(void (*run)(void)) {
    after = run;
}

void tests_set_runner(int (*run)(void)) {
    runner = run;
}

static void add_all(void) {
    for (guint i = 0; tests && i < tests->len; i++) {
        const struct test *test = &g_array_index(tests, struct test, i);
        g_test_add_func(test->path, test->run);
    }
}

int tests_run(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    if (before)
        before();
    add_all();
    const int result = runner();
    if (after)
        after();
    return result;
}
