/* An OpenGL context for a test that draws. Without OpenGL, the test is skipped. */
#pragma once

#include "drawing/gl/gpu.h"
#include "skip.h"

struct fixture {
    Gpu *gpu;
};

/* Adds a test that runs with a separate context. data is passed to run. */
void gpu_fixture_add(const char *path, void (*run)(gconstpointer data), gconstpointer data);

/* For g_test_add(). gpu is NULL if the test is skipped. */
void gpu_fixture_set_up(struct fixture *f, gconstpointer data);
void gpu_fixture_tear_down(struct fixture *f, gconstpointer data);
