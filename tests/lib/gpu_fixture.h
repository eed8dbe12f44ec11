/* An OpenGL context for a test that draws; where there is none the test is skipped. */
#pragma once

#include "drawing/gl/gpu.h"
#include "skip.h"

struct fixture {
    Gpu *gpu;
};

/* Adds a test that runs with a context of its own. data: for run. */
void gpu_fixture_add(const char *path, void (*run)(gconstpointer data), gconstpointer data);

/* For g_test_add(): gpu is NULL where the test is skipped. */
void gpu_fixture_set_up(struct fixture *f, gconstpointer data);
void gpu_fixture_tear_down(struct fixture *f, gconstpointer data);
