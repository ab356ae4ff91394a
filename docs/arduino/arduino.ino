// Logs an MPU-6050 at 200 Hz to the serial port at 1 Mbaud: counts at +-4 g and +-500 deg/s, stamps
// in microseconds, the temperature in degC. The MPU-6500 and 9250 have the same registers, but the
// temperature value / 333.87 + 21.
#include <Wire.h>

uint32_t next;

void set(uint8_t address, uint8_t value) {
  Wire.beginTransmission(0x68);
  Wire.write(address);
  Wire.write(value);
  Wire.endTransmission();
}

void setup() {
  Serial.begin(1000000);
  Wire.begin();
  Wire.setClock(400000);
  set(0x6B, 1);  // wake up; clock of the gyroscope
  set(0x1A, 2);  // low-pass filter at 94 Hz
  set(0x1B, 8);  // +-500 deg/s
  set(0x1C, 8);  // +-4 g
  Serial.println("micros,ax [lsb],ay [lsb],az [lsb],temperature,gx [lsb],gy [lsb],gz [lsb]");
  next = micros();
}

void loop() {
  while ((int32_t)(micros() - next) < 0) {}
  next += 5000;  // 200 Hz
  uint32_t stamp = micros();
  Wire.beginTransmission(0x68);
  Wire.write(0x3B);
  Wire.endTransmission(false);
  Wire.requestFrom(0x68, 14);
  Serial.print(stamp);
  for (int i = 0; i < 7; i++) {
    uint16_t high = Wire.read();
    int16_t value = high << 8 | Wire.read();
    Serial.print(',');
    if (i == 3) Serial.print(value / 340.0 + 36.53);
    else Serial.print(value);
  }
  Serial.println();
}
