/*
 * The tasks of lamps and lasers by hand (web_task.h). The name of a task is that of the light in
 * the rig file. A light goes off when its lease ends, when mesorig-web ends, and in all cases in
 * which mesorigd switches it off (SetLamp in etc/org.mesorig.Rig1.xml). The lease of a client is
 * short, so that a page that was closed or has lost its connection leaves no light on.
 */
#pragma once

#include "web_task.h"

#define WEB_HANDS_MAX_LEASE_S 15

/* Switch a lamp or laser on. The query has the lease in seconds, from 0.1 to WEB_HANDS_MAX_LEASE_S:
 * for_s=5. The same request begins the lease again. The task is answered with {} when the light is
 * stable. */
void web_hands_lamp_on(const struct web_task *task);
void web_hands_laser_on(const struct web_task *task);
/* Switch a lamp or laser off. The task is answered with {} when the light has confirmed that it is
 * off. */
void web_hands_lamp_off(const struct web_task *task);
void web_hands_laser_off(const struct web_task *task);
