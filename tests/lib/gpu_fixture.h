/* An OpenGL context for a test that draws; where there is none the test is skipped. */
#pragma once

#include "gl/gpu.h"
#include "skip.h"

struct fixture {
    Gpu *gpu;
};

void gpu_fixture_set_up(struct fixture *f, gconstpointer data);
void gpu_fixture_tear_down(struct fixture *f, gconstpointer data);
