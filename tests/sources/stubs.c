/* Functions of FMI 2 and 3 that tests/sources/device.c does not need: fmpy wants every one of them to be there. */
#define NO(name) int name(void) { return 3; }
#if FMI == 2
NO(fmi2DeSerializeFMUstate) NO(fmi2GetDirectionalDerivative) NO(fmi2GetIntegerStatus) NO(fmi2GetRealOutputDerivatives)
NO(fmi2GetStringStatus) NO(fmi2SerializeFMUstate) NO(fmi2SerializedFMUstateSize)
NO(fmi2SetRealInputDerivatives)
#endif
#if FMI == 3
NO(fmi3ActivateModelPartition) NO(fmi3DeserializeFMUState) NO(fmi3EnterConfigurationMode) NO(fmi3EvaluateDiscreteStates)
NO(fmi3ExitConfigurationMode) NO(fmi3GetAdjointDerivative) NO(fmi3GetBinary) NO(fmi3GetBoolean) NO(fmi3GetClock)
NO(fmi3GetDirectionalDerivative) NO(fmi3GetInt16) NO(fmi3GetInt32) NO(fmi3GetInt64) NO(fmi3GetInt8)
NO(fmi3GetIntervalDecimal) NO(fmi3GetIntervalFraction) NO(fmi3GetNumberOfVariableDependencies) NO(fmi3GetOutputDerivatives)
NO(fmi3GetShiftDecimal) NO(fmi3GetShiftFraction) NO(fmi3GetString) NO(fmi3GetUInt16) NO(fmi3GetUInt32) NO(fmi3GetUInt64) NO(fmi3GetUInt8)
NO(fmi3GetVariableDependencies) NO(fmi3InstantiateScheduledExecution) NO(fmi3SerializeFMUState) NO(fmi3SerializedFMUStateSize) NO(fmi3SetBinary)
NO(fmi3SetBoolean) NO(fmi3SetInt16) NO(fmi3SetInt32) NO(fmi3SetInt64) NO(fmi3SetInt8)
NO(fmi3SetIntervalDecimal) NO(fmi3SetIntervalFraction) NO(fmi3SetShiftDecimal) NO(fmi3SetShiftFraction) NO(fmi3SetString) NO(fmi3SetUInt16)
NO(fmi3SetUInt32) NO(fmi3SetUInt64) NO(fmi3SetUInt8)
#endif
