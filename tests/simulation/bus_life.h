/*
 * One life of the daemon on the bus, as mesorigd serves: a bus (daemon/bus), simulated devices on
 * lines that lose answers, scripted clients. In a process forked for it. Never returns.
 */
#pragma once

#include "bus_schedule.h"
#include "scene.h"

G_NORETURN void bus_life(struct scene *scene, const struct bus_schedule *schedule);
