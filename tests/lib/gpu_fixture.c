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
