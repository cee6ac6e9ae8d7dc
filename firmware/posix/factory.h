/* The flash of a device that was just made: nothing but a factory image (FWU-016). */
#ifndef FACTORY_H
#define FACTORY_H

#include <stdint.h>

#define FACTORY_FLASH 0x400000u /* bytes of the flash: FWU-016 */

/* Fills `flash`, FACTORY_FLASH bytes, with ones and a factory image of this version: two small segments, not signed,
   the record confirmed. */
void factory_image(uint8_t *flash, const uint8_t firmware[3]);

#endif
