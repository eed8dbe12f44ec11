/*
 * The simulated world's own log of what cameras truly saw. The linker puts it between the simulated
 * cameras and the world (--wrap=world_expose).
 */
#pragma once

#include "scene.h"

/* From now on into the scene's list; NULL: no more. */
void exposures_note(struct scene *scene);
