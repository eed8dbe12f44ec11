/*
 * One life of the daemon: what mesorigd does between its start and its end, with the simulated rig
 * and the simulated disk, in a process forked for it. Never returns.
 */
#pragma once

#include "scene.h"

/* Begins the session, or resumes it if there is one, and captures until it rests for good; or
 * makes the products. */
G_NORETURN void life_capture(struct scene *scene, const struct life *life);
G_NORETURN void life_process(struct scene *scene);

/* A second daemon that tries to resume the same session. Its exit status: 0 it was locked out, 1 it
 * was not, 2 it failed otherwise. */
G_NORETURN void life_second(struct scene *scene);
