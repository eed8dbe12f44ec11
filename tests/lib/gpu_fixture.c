#include "gpu_fixture.h"

void gpu_fixture_set_up(struct fixture *f, gconstpointer data) {
    g_autoptr(GError) error = NULL;
    f->gpu = gpu_new_headless(&error);
    if (f->gpu == NULL)
        test_skip_or_fail(error->message);
}

void gpu_fixture_tear_down(struct fixture *f, gconstpointer data) {
    gpu_free(f->gpu);
}

struct gpu_test {
    void (*run)(gconstpointer data);
    gconstpointer data;
};

static void gpu_fixture_run(gconstpointer data) {
    const struct gpu_test *test = data;
    struct fixture f;
    gpu_fixture_set_up(&f, NULL);
    if (f.gpu != NULL)
        test->run(test->data);
    gpu_fixture_tear_down(&f, NULL);
}

void gpu_fixture_add(const char *path, void (*run)(gconstpointer data), gconstpointer data) {
    const struct gpu_test test = {run, data};
    g_test_add_data_func_full(path, g_memdup2(&test, sizeof test), gpu_fixture_run, g_free);
}
