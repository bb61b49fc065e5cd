// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using Hfx.Haptics;
using UnityEngine;

/// <summary>
/// A <see cref="HapticBody"/> among volumes of a clip with two bones, "root" and "wrist.L" (Mixamo "LeftHand"), and the
/// effects "Volume 0" to "Volume 3" and "Painted", the clip of tests/players/small_clip.py. Each demand has a name.
/// </summary>
static class Bodies
{
    /// <summary>Inverse kinematics of another package: it moves a bone in LateUpdate.</summary>
    [DefaultExecutionOrder(9999)]
    sealed class Reach : MonoBehaviour
    {
        public Transform bone;
        public float x;
        void LateUpdate() { bone.localToWorldMatrix = At(x); }
    }

    static int wrong;

    public static int Play(string path, string conformance)
    {
        wrong = 0;
        HapticClipAsset asset = ScriptableObject.CreateInstance<HapticClipAsset>();
        asset.SetBytes(File.ReadAllBytes(path));
        Order(asset);
        SeveralVolumes(asset);
        Disabling(asset);
        Settings(asset, path);
        Names(asset);
        Controllers(asset);
        Library(asset, path, conformance);
        Garbage(asset);
        return wrong;
    }

    /// <summary>The pose after LateUpdate of other scripts is felt, in whatever order the components were added.</summary>
    static void Order(HapticClipAsset asset)
    {
        HapticBody body = Body(asset, "root", "LeftHand");
        Reach reach = new Reach { bone = body.transform.all[1] };
        HapticVolume far = Volume("Volume 1", 100.0f);
        List<MonoBehaviour> components = new List<MonoBehaviour> { body, reach };
        Frames.Play(components, () => body.transform.all[0].localToWorldMatrix = At(0.0f));
        float before = Felt(body, far);
        reach.x = 100.0f;
        Frames.Play(components, () => body.transform.all[0].localToWorldMatrix = At(100.0f));
        Demand(before == 0.0f && Felt(body, far) > 0.0f, "the pose after animation and LateUpdate of others is felt at once");
        Remove(far);
        GameObject.Call(body, "OnDisable");
    }

    static void SeveralVolumes(HapticClipAsset asset)
    {
        HapticBody body = Body(asset, "root", "wrist.L");
        HapticVolume one = Volume("Volume 1", 0.0f), other = Volume("Volume 1", 0.0f), far = Volume("Volume 1", 50.0f);
        Frame(body);
        Demand(Felt(body, one) > 0.0f && Felt(body, other) == Felt(body, one) && Felt(body, far) == 0.0f, "each volume of an effect acts by itself");
        int number = body.NumberOf(other);
        Remove(one);
        Frame(body);
        Demand(body.NumberOf(one) < 0 && body.NumberOf(other) == number && Felt(body, other) > 0.0f, "a disabled volume leaves the others as they are");
        other.Level = 0.5f;
        Frame(body);
        double half = body.Core.GetLevel(number);
        other.Level = 1.0f;
        Frame(body);
        Demand(half > 0.0 && Math.Abs(body.Core.GetLevel(number) - 2.0 * half) < 1e-6, "a level multiplies the effect's own");
        other.Effect = "Volume 2";
        Frame(body);
        Demand(body.Core.GetWeights(number).Length == 0 && body.NumberOf(other) >= 0, "a volume gets another effect");
        Debug.messages.Clear();
        other.Effect = "Volume 7";
        Frame(body);
        Frame(body);
        Demand(Debug.messages.Count == 1 && Debug.messages[0].Contains("'Volume 7'"), "an unknown effect is named once");
        Remove(other);
        Remove(far);
        GameObject.Call(body, "OnDisable");
    }

    static void Disabling(HapticClipAsset asset)
    {
        HapticBody body = Body(asset, "root", "wrist.L");
        body.Trigger("Painted", 1.0f);
        Frame(body);
        float felt = body.Values[0];
        int events = 0;
        body.ValuesChanged += of => events += of.Values[0] == 0.0f ? 1 : 0;
        GameObject.Call(body, "OnDisable");
        Demand(felt > 0.0f && events == 1, "disabling silences");
        GameObject.Call(body, "OnEnable");
        Frame(body);
        Demand(body.Values[0] == felt, "enabled again, it feels, and a painted area stays on");
        GameObject.Call(body, "OnApplicationPause", true);
        GameObject.Call(body, "OnApplicationFocus", false);
        GameObject.Call(body, "OnApplicationFocus", true);
        Frame(body);
        Demand(body.Values[0] == 0.0f, "a pause outlasts a focus that is lost and found");
        GameObject.Call(body, "OnApplicationPause", false);
        Frame(body);
        Demand(body.Values[0] == felt, "it goes on");
        // An avatar that moves far while nothing is felt has no speed afterwards: Volume 1 has a speed filter.
        HapticVolume volume = Volume("Volume 1", 0.0f);
        Frame(body);
        double still = body.Core.GetLevel(body.NumberOf(volume));
        Time.timeScale = 0.0f;
        Frame(body);
        volume.transform.localToWorldMatrix = At(0.05f);
        Time.timeScale = 1.0f;
        Frame(body);
        Demand(Math.Abs(body.Core.GetLevel(body.NumberOf(volume)) - still) < 1e-9, "what moved while time stood still is no touch");
        Remove(volume);
        GameObject.Call(body, "OnDisable");
    }

    static void Settings(HapticClipAsset asset, string path)
    {
        GameObject avatar = new GameObject();
        Debug.messages.Clear();
        HapticBody body = avatar.AddComponent<HapticBody>();
        Frame(body);
        Frame(body);
        Demand(body.Core == null && Debug.messages.Count == 1 && Debug.messages[0].Contains("choose a clip"), "a missing clip is said once");
        avatar.transform.all.Add(new Transform { name = "root" });
        body.Trigger("Painted", 1.0f);
        body.Asset = asset;
        Frame(body);
        Demand(body.Values != null && body.Values[0] > 0.0f, "a clip and a trigger that come after AddComponent");
        Demand(Debug.messages.Count == 2 && Debug.messages[1].Contains("wrist.L") && body.MissingBones.Length == 1, "a missing bone is named");
        avatar.transform.all.Add(new Transform { name = "hand_l" });
        GameObject.Call(body, "OnTransformChildrenChanged");
        Frame(body);
        Demand(body.MissingBones.Length == 0 && Debug.messages.Count == 2, "a bone that comes later is found");
        HapticClipAsset again = ScriptableObject.CreateInstance<HapticClipAsset>();
        again.SetBytes(File.ReadAllBytes(path));
        LiveBody core = body.Core;
        body.Asset = again;
        Frame(body);
        Demand(body.Core != core && body.Core.Clip == again.Clip && body.Values[0] > 0.0f, "another clip is played");
        body.BodyName = "Nobody";
        Frame(body);
        Demand(body.Core == null && Debug.messages[2].Contains("'Nobody', but: Body"), "an unknown body is named");
        body.BodyName = "Body";
        Frame(body);
        Demand(body.Core != null, "a name that is right again");
        GameObject.Call(body, "OnDisable");
    }

    const string Human = "hips spine chest upperChest neck head leftShoulder leftUpperArm leftLowerArm leftHand leftThumbMetacarpal leftThumbProximal leftThumbDistal leftIndexProximal leftLittleDistal rightUpperLeg rightLowerLeg rightFoot rightToes";

    /// <summary>Human bones of avatars named by common conventions, in the order of Human; -: there is none.</summary>
    static void Names(HapticClipAsset asset)
    {
        string[] human = Human.Split(' ');
        string[] avatars =
        {
            "mixamorig:Hips mixamorig:Spine mixamorig:Spine1 mixamorig:Spine2 mixamorig:Neck mixamorig:Head mixamorig:LeftShoulder mixamorig:LeftArm mixamorig:LeftForeArm mixamorig:LeftHand mixamorig:LeftHandThumb1 mixamorig:LeftHandThumb2 mixamorig:LeftHandThumb3 mixamorig:LeftHandIndex1 mixamorig:LeftHandPinky3 mixamorig:RightUpLeg mixamorig:RightLeg mixamorig:RightFoot mixamorig:RightToeBase", // Mixamo
            "mixamorig7_Hips mixamorig7_Spine mixamorig7_Spine1 mixamorig7_Spine2 mixamorig7_Neck mixamorig7_Head mixamorig7_LeftShoulder mixamorig7_LeftArm mixamorig7_LeftForeArm mixamorig7_LeftHand mixamorig7_LeftHandThumb1 mixamorig7_LeftHandThumb2 mixamorig7_LeftHandThumb3 mixamorig7_LeftHandIndex1 mixamorig7_LeftHandPinky3 mixamorig7_RightUpLeg mixamorig7_RightLeg mixamorig7_RightFoot mixamorig7_RightToeBase", // Mixamo, other prefix
            "Hips Spine Chest UpperChest Neck Head LeftShoulder LeftUpperArm LeftLowerArm LeftHand LeftThumbMetacarpal LeftThumbProximal LeftThumbDistal LeftIndexProximal LeftLittleDistal RightUpperLeg RightLowerLeg RightFoot RightToes", // Godot
            "Hips Spine Chest UpperChest Neck Head LeftShoulder LeftUpperArm LeftLowerArm LeftHand LeftThumbProximal LeftThumbIntermediate LeftThumbDistal LeftIndexProximal LeftLittleDistal RightUpperLeg RightLowerLeg RightFoot RightToes", // Unity
            "J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_Chest J_Bip_C_UpperChest J_Bip_C_Neck J_Bip_C_Head J_Bip_L_Shoulder J_Bip_L_UpperArm J_Bip_L_LowerArm J_Bip_L_Hand J_Bip_L_Thumb1 J_Bip_L_Thumb2 J_Bip_L_Thumb3 J_Bip_L_Index1 J_Bip_L_Little3 J_Bip_R_UpperLeg J_Bip_R_LowerLeg J_Bip_R_Foot J_Bip_R_ToeBase", // VRoid
            "pelvis spine_01 spine_02 spine_03 neck_01 head clavicle_l upperarm_l lowerarm_l hand_l thumb_01_l thumb_02_l thumb_03_l index_01_l pinky_03_l thigh_r calf_r foot_r ball_r", // Unreal
            "DEF-spine DEF-spine.001 DEF-spine.002 DEF-spine.003 DEF-spine.004 DEF-spine.006 DEF-shoulder.L DEF-upper_arm.L DEF-forearm.L DEF-hand.L DEF-thumb.01.L DEF-thumb.02.L DEF-thumb.03.L DEF-f_index.01.L DEF-f_pinky.03.L DEF-thigh.R DEF-shin.R DEF-foot.R DEF-toe.R", // Rigify
            "Bip01_Pelvis Bip01_Spine Bip01_Spine1 Bip01_Spine2 Bip01_Neck Bip01_Head Bip01_L_Clavicle Bip01_L_UpperArm Bip01_L_Forearm Bip01_L_Hand Bip01_L_Finger0 Bip01_L_Finger01 Bip01_L_Finger02 Bip01_L_Finger1 Bip01_L_Finger42 Bip01_R_Thigh Bip01_R_Calf Bip01_R_Foot Bip01_R_Toe0", // Biped
            "CC_Base_Hip CC_Base_Waist CC_Base_Spine01 CC_Base_Spine02 CC_Base_NeckTwist01 CC_Base_Head CC_Base_L_Clavicle CC_Base_L_Upperarm CC_Base_L_Forearm CC_Base_L_Hand CC_Base_L_Thumb1 CC_Base_L_Thumb2 CC_Base_L_Thumb3 CC_Base_L_Index1 CC_Base_L_Pinky3 CC_Base_R_Thigh CC_Base_R_Calf CC_Base_R_Foot CC_Base_R_ToeBase", // Character Creator
            "Pelvis Spine1 Spine2 Spine3 Neck Head L_Collar L_Shoulder L_Elbow L_Wrist - - - - - R_Hip R_Knee R_Ankle -", // SMPL
            "hips spine chest upperchest neck head leftshoulder leftarm leftforearm handl - - - - - thighr shinr rightfoot rtoe", // sides joined
        };
        foreach (string avatar in avatars)
        {
            string[] names = avatar.Split(' ');
            Dictionary<string, Transform> found = BoneNames.HumanBones(Chain(names));
            string seen = string.Join(" ", human.Select(bone => found.ContainsKey(bone) ? found[bone].name : "-"));
            Demand(seen == avatar, "names of bones: " + seen);
        }
        string others = "hand_ik.L upperarm_twist_01_l ORG-thigh.L hair_01 camera root mixamorig:LeftHandThumb4";
        Demand(BoneNames.HumanBones(Chain(others.Split(' '))).Count == 0, "bones that are none of a body's own");
        // The clip's own rig goes by its own names, with the separators of another program.
        Bone[] bones = { Named("root", "hips"), Named("wrist.L", "leftHand"), Named("finger1-1.L", "leftThumbMetacarpal") };
        Transform[] own = Chain("Armature root wrist_L finger1-1_L hand_L".Split(' '));
        Demand(BoneNames.Find(bones, own, null).SequenceEqual(own.Skip(1).Take(3)), "the clip's own rig");
        // "root" is Unreal's floor, not the hips of the clip; a chest that is not there follows the spine.
        Bone[] trunk = { Named("root", "hips"), Named("spine01", "upperChest"), Named("spine05", "spine"), Named("upperleg01.L", "leftUpperLeg"), Named("wrist.L", "leftHand") };
        Transform[] unreal = Chain("root pelvis spine_01 thigh_l".Split(' '));
        Demand(BoneNames.Find(trunk, unreal, null).SequenceEqual(new[] { unreal[1], unreal[2], unreal[2], unreal[3], null }), "Unreal's root is not the hips");
        Demand(asset.Clip.Bodies[0].Bones.All(bone => bone.HasSkin), "both bones carry skin");
    }

    /// <summary>Transforms, each the child of the one before; a name of - is left out.</summary>
    static Transform[] Chain(string[] names)
    {
        List<Transform> all = new List<Transform>();
        foreach (string name in names)
            if (name != "-") all.Add(new Transform { name = name, parent = all.LastOrDefault() });
        return all.ToArray();
    }

    /// <summary>An avatar with two clips has two bodies; both are felt on one controller.</summary>
    static void Controllers(HapticClipAsset asset)
    {
        HapticBody body = Body(asset, "root", "wrist.L"), other = Body(asset, "root", "wrist.L");
        ControllerHaptics controllers = new GameObject().AddComponent<ControllerHaptics>();
        controllers.Body = body;
        controllers.FurtherBodies = new[] { other };
        other.Trigger("Painted", 1.0f);
        Frame(body);
        Frame(other);
        Frame(body);
        Demand(UnityEngine.XR.InputDevice.amplitude > 0.0f, "a further body is felt");
        controllers.FurtherBodies = null;
        Frame(body);
        Demand(UnityEngine.XR.InputDevice.amplitude == 0.0f, "a further body is taken away");
        GameObject.Call(controllers, "OnDisable");
        GameObject.Call(body, "OnDisable");
        GameObject.Call(other, "OnDisable");
    }

    /// <summary>Effects of another clip, felt by its names on the body and the devices of the first.</summary>
    static void Library(HapticClipAsset asset, string path, string conformance)
    {
        HapticClipAsset library = ScriptableObject.CreateInstance<HapticClipAsset>();
        library.SetBytes(File.ReadAllBytes(path));
        HapticBody body = Body(asset, "root", "wrist.L");
        Debug.messages.Clear();
        body.Trigger("Painted", 1.0f);
        Frame(body);
        float own = body.Values[0];
        body.EffectAsset = library;
        Frame(body);
        Demand(Debug.messages.Count == 0, "nothing is missing");
        Demand(own > 0.0f && body.Values[0] == own && body.Core.EffectClip == library.Clip, "effects of a library, a trigger stays");
        Demand(body.Place("Painted", 0.0f, 50.0f) && !body.Place("Nothing", 90.0f), "painted areas are placed by name");
        Frame(body);
        Demand(body.Values[0] == 0.0f, "a painted area above the body is not felt");
        string other = Path.Combine(Path.GetDirectoryName(Path.GetDirectoryName(conformance)), "behaviour", "library.hfxclip");
        library.SetBytes(File.ReadAllBytes(other));
        body.EffectAsset = library;
        Frame(body);
        Demand(Debug.messages.Count == 1 && Debug.messages[0].Contains("feel Dot, Ball, Numbers, Heat:"), "effects without skin are named");
        body.EffectAsset = null;
        Frame(body);
        Demand(body.Values[0] == 0.0f && body.EffectClip == asset.Clip, "its place stays, the effects are the clip's own again");
        body.Place("Painted", 0.0f);
        Frame(body);
        Demand(body.Values[0] == own, "as made again");
        GameObject.Call(body, "OnDisable");
    }

    static void Garbage(HapticClipAsset asset)
    {
        HapticBody body = Body(asset, "root", "wrist.L");
        List<HapticVolume> volumes = new List<HapticVolume>();
        for (int k = 0; k < 8; k++) volumes.Add(Volume("Volume " + k % 4, 0.1f * k));
        Action frame = (Action)Delegate.CreateDelegate(typeof(Action), body, "LateUpdate");
        body.Trigger("Painted", 1.0f);
        frame();
        long before = GC.GetTotalMemory(true);
        for (int k = 0; k < 2000; k++)
        {
            body.Trigger("Painted", 0.5f);
            frame();
            if (k % 2 == 0) HapticVolume.All.Remove(volumes[0]); // shot and gone
            else HapticVolume.All.Add(volumes[0]);
        }
        long grown = GC.GetTotalMemory(false) - before;
        Demand(grown < 1000, "no garbage in 2,000 frames: " + grown + " bytes");
        foreach (HapticVolume volume in volumes) Remove(volume);
        GameObject.Call(body, "OnDisable");
    }

    static Bone Named(string name, string human) { return new Bone { Name = name, Human = human, Mixamo = "", Unreal = "" }; }

    static HapticBody Body(HapticClipAsset asset, params string[] bones)
    {
        GameObject avatar = new GameObject();
        foreach (string bone in bones) avatar.transform.all.Add(new Transform { name = bone });
        HapticBody body = avatar.AddComponent<HapticBody>();
        body.Asset = asset;
        return body;
    }

    static HapticVolume Volume(string effect, float x)
    {
        HapticVolume volume = new GameObject().AddComponent<HapticVolume>();
        volume.Effect = effect;
        volume.transform.localToWorldMatrix = At(x);
        return volume;
    }

    static void Remove(HapticVolume volume) { GameObject.Call(volume, "OnDisable"); }

    static Matrix4x4 At(float x)
    {
        Matrix4x4 found = Matrix4x4.identity;
        found.m03 = x;
        return found;
    }

    static float Felt(HapticBody body, HapticVolume volume)
    {
        return body.Core.GetWeights(body.NumberOf(volume)).DefaultIfEmpty().Max();
    }

    static void Frame(HapticBody body) { GameObject.Call(body, "LateUpdate"); }

    static void Demand(bool holds, string what)
    {
        if (holds) return;
        wrong++;
        Console.WriteLine("not held: " + what);
    }
}
