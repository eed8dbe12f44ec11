/* An OpenGL context for a test that draws; where there is none the test is skipped. */
#pragma once

#include "gl/gpu.h"
#include "skip.h"

struct fixture {
    Gpu *gpu;
};

static inline void set_up(struct fixture *f, gconstpointer data) {
    g_autoptr(GError) error = NULL;
    f->gpu = gpu_new_headless(&error);
    if (f->gpu == NULL)
        test_skip_or_fail(error->message);
}

static inline void tear_down(struct fixture *f, gconstpointer data) {
    gpu_free(f->gpu);
}
