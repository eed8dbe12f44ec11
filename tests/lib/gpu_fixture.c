#include "gpu_fixture.h"

/* Returns NULL if the test is skipped. */
static Gpu *gpu_fixture_new(void) {
    g_autoptr(GError) error = NULL;
    Gpu *gpu = gpu_new_headless(&error);
    if (gpu == NULL)
        test_skip_or_fail(error->message);
    return gpu;
}

void gpu_fixture_run(void (*run)(void)) {
    g_autoptr(Gpu) gpu = gpu_fixture_new();
    if (gpu != NULL)
        run();
}

struct gpu_test {
    void (*run)(gconstpointer data);
    gconstpointer data;
};

static void gpu_fixture_run_data(gconstpointer data) {
    const struct gpu_test *test = data;
    g_autoptr(Gpu) gpu = gpu_fixture_new();
    if (gpu != NULL)
        test->run(test->data);
}

void gpu_fixture_add(const char *path, void (*run)(gconstpointer data), gconstpointer data) {
    const struct gpu_test test = {run, data};
    g_test_add_data_func_full(path, g_memdup2(&test, sizeof test), gpu_fixture_run_data, g_free);
}
