// Answers every byte with its successor, at the baud of the project.
#include <Arduino.h>

void setup() { Serial.begin(250000); }

void loop() {
    if (Serial.available() > 0) Serial.write(static_cast<uint8_t>(Serial.read() + 1));
}
